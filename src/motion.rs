//! Motion as mathematics: limits of an axis, feed profiles, and the trajectory of a session.
//!
//! Nothing here knows a device. [`axis`] answers whether a target is allowed, [`profile`] how long
//! a move takes and where it is at an instant, [`chain`] which joint angles put an arm's tool somewhere, [`arm`]
//! how such an arm moves straight,
//! [`trajectory`] is the one value that both the bench and the twin follow.

pub mod arm;
pub mod axis;
pub mod chain;
pub mod pose_map;
pub mod profile;
pub mod trajectory;

pub use arm::Arm;
pub use axis::{AxisKind, AxisLimits, LimitError};
pub use chain::{Chain, Joint, Place, ReachError};
pub use pose_map::{AxisRole, Coordinate, PoseMap};
pub use profile::Profile;
pub use trajectory::{CaptureMark, Episode, Phase, Primitive, SlideDirection, Trajectory, Waypoint};
