//! What whoever uses an imager's pictures is told.

use super::Background;
use crate::optics::fast::WORKED;
use crate::percent::reads_above;

/// What whoever uses the pictures should know.
#[derive(Debug, Clone, PartialEq)]
pub enum Notice {
    /// The fast mode cannot render this sensor: the reference mode does, far slower.
    FellBack {
        /// Why.
        why: String,
        /// Samples a pixel.
        samples: u32,
        /// relRMSE of the noise to expect.
        noise: Option<f64>,
    },
    /// The fast mode renders this sensor, but not this pad: the reference mode does, once.
    PictureFellBack {
        /// Why.
        why: String,
        /// Samples a pixel.
        samples: u32,
        /// relRMSE of the noise to expect.
        noise: Option<f64>,
    },
    /// No light shines.
    Dark,
    /// Much of the image of the untouched sensor is at an end of the scale.
    BackgroundClipped {
        /// Which part of its pixels.
        part: f64,
        /// Whether they are white, else black.
        white: bool,
    },
    /// The fast mode has no work to pick for what is asked.
    BeyondWork {
        /// relRMSE asked for.
        tolerance: f64,
    },
    /// A picture may be worse than was asked for.
    AboveTolerance {
        /// relRMSE to expect.
        estimated: f64,
        /// relRMSE asked for.
        tolerance: f64,
    },
}

impl std::fmt::Display for Notice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Notice::FellBack { why, samples, noise } => {
                write!(f, "pictures are made in the reference mode, {}", traced(why, *samples, *noise))
            }
            Notice::PictureFellBack { why, samples, noise } => {
                write!(f, "the picture is made in the reference mode, {}", traced(why, *samples, *noise))
            }
            Notice::Dark => write!(
                f,
                "no light of the sensor shines, so its simulated pictures are black; give one an energy and a colour above 0"
            ),
            Notice::BackgroundClipped { part, white } => write!(
                f,
                "{:.0} % of the image of the untouched sensor is {}: nothing of the face shows there, in simulated \
                 pictures either. Take it again with a {} exposure",
                100.0 * part,
                if *white { "white" } else { "black" },
                if *white { "shorter" } else { "longer" }
            ),
            Notice::BeyondWork { tolerance } => {
                let [finest, coarsest] = WORKED;
                let (done, next) = match *tolerance < finest {
                    true => (
                        format!(
                            "takes longer than {finest} does and brings a picture hardly nearer to the truth"
                        ),
                        "the reference mode does",
                    ),
                    false => (
                        format!("saves little over {coarsest}, and nothing of most pictures"),
                        "smaller pictures do",
                    ),
                };
                write!(
                    f,
                    "a tolerance picks the fast mode's work from {finest} to {coarsest}; {tolerance} {done}: {next}"
                )
            }
            Notice::AboveTolerance { estimated, tolerance } => write!(
                f,
                "the picture's relRMSE is estimated at {:.2} %, above the {:.2} % asked for; \
                 the reference mode has no such limit",
                100.0 * estimated,
                100.0 * tolerance
            ),
        }
    }
}

impl Notice {
    /// What to say of a picture that states such an error where another is asked for, if anything: nothing of a difference that does
    /// not show.
    pub fn of_error(estimated: f64, tolerance: f64) -> Option<Self> {
        reads_above(estimated, tolerance).then_some(Notice::AboveTolerance { estimated, tolerance })
    }

    /// What to say of a tolerance of the fast mode, if anything.
    pub fn of_tolerance(tolerance: f64) -> Option<Self> {
        let [finest, coarsest] = WORKED;
        (!(finest..=coarsest).contains(&tolerance)).then_some(Notice::BeyondWork { tolerance })
    }
}

/// What to know of pictures that are traced.
fn traced(why: &str, samples: u32, noise: Option<f64>) -> String {
    let noise =
        noise.map_or_else(String::new, |noise| format!(" and leaves {:.1} % of noise", 100.0 * noise));
    format!(
        "{samples} samples a pixel, which is slow{noise}: {why}. An optics.samples above {samples} in the rig file takes \
         more samples, and less noise: four times as many leave half of it or less"
    )
}

/// What is to be said of an image whose pixels are white or black in all colours, from this part of them on.
const MUCH: f64 = 0.25;

/// What to say of an image of the untouched sensor, if anything.
pub(super) fn clipped(image: &Background<'_>) -> Option<Notice> {
    let part = |code: u8| {
        let pixels = image.rgb.chunks_exact(3).filter(|p| p.iter().all(|c| *c == code));
        pixels.count() as f64 / (image.width * image.height) as f64
    };
    let (black, white) = (part(0), part(u8::MAX));
    let notice = Notice::BackgroundClipped { part: black.max(white), white: white > black };
    (black.max(white) >= MUCH).then_some(notice)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_reads_as_the_one_asked_for_is_not_told() {
        assert_eq!(Notice::of_error(0.00504, 0.005), None);
        assert_eq!(Notice::of_error(0.004, 0.005), None);
        let told = Notice::of_error(0.00506, 0.005).expect("a notice").to_string();
        assert!(told.contains("0.51 %, above the 0.50 % asked for"), "{told}");
    }
}
