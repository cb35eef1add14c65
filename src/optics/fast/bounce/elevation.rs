//! Weights of what is seen under some elevations in one direction around.
//!
//! Elevations are slopes over the level; a weight is the integral of both cosines up to one.

use crate::optics::fast::lanes::{Eight, Mask};
use std::f32::consts::FRAC_PI_2;

/// What rises from one slope and its weight to another hides of what is above the level, from one weight to another, and how
/// much of what is below.
#[inline(always)]
pub fn shares([before, below]: [Eight; 2], [rise, now]: [Eight; 2], risen: Mask) -> ([Eight; 2], Eight) {
    let zero = Eight::all(0.0);
    let positive = zero.below(rise);
    let from = zero.below(before).choose(below, zero);
    let to = risen.choose(positive.choose(now, from), from);
    let of_ground = before.below(zero).choose(positive.choose(zero, now) - below, zero);
    ([from, to], risen.choose(of_ground, zero))
}

/// The mean slope under which is seen what reaches from one slope and its weight to another, for normals with the part `along`
/// ahead and `up` upwards.
#[inline(always)]
pub fn mean_slope([from, low]: [Eight; 2], [to, high]: [Eight; 2], [along, up]: [Eight; 2]) -> Eight {
    let steepest = Eight::all(1e4);
    let [from, to] = [from, to].map(|slope| slope.max(-steepest).min(steepest));
    // (As `weight`, times the slope.)
    let moment = |slope: Eight| {
        let cos2 = Eight::all(1.0).over(Eight::all(1.0) + slope * slope);
        (along * slope * slope * cos2 + up * (slope.atan() - slope * cos2)) * Eight::all(0.5)
    };
    let mean = (moment(to) - moment(from)).over((high - low).max(Eight::all(1e-9)));
    mean.max(from).min(to)
}

/// Integral of cos(tilt) cos(elevation) up to elevations of these slopes, for normals with the part `along` ahead and
/// `up` upwards; 0 at slope 0.
#[inline(always)]
pub fn weight(slope: Eight, along: Eight, up: Eight) -> Eight {
    let cos2 = Eight::all(1.0).over(Eight::all(1.0) + slope * slope);
    (along * (slope.atan() + slope * cos2) + up * slope * slope * cos2) * Eight::all(0.5)
}

/// The slope below which a surface's own plane hides everything, and its weight, for normals as in [`weight`]. An upright one hides
/// nothing.
#[inline(always)]
pub fn own_plane(along: Eight, up: Eight) -> [Eight; 2] {
    let upright = Eight::all(1e-3).below(up);
    let slope = upright.choose((-along).over(up), Eight::all(f32::NEG_INFINITY));
    let of_all = (up - along * Eight::all(FRAC_PI_2)) * Eight::all(0.5);
    [slope, upright.choose(weight(slope, along, up), of_all)]
}
