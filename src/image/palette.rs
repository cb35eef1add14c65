//! The colours of lines in plots.

use plotters::style::RGBColor;

/// Mid-tones that stand out on white and on near-black, and from each other.
pub const SERIES: [RGBColor; 8] = [
    RGBColor(31, 119, 180),
    RGBColor(225, 110, 20),
    RGBColor(40, 150, 75),
    RGBColor(200, 60, 70),
    RGBColor(140, 100, 200),
    RGBColor(150, 105, 80),
    RGBColor(215, 105, 180),
    RGBColor(20, 160, 175),
];
