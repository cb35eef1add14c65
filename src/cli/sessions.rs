//! The sessions of a rig, for commands that ask others before they open anything.

use super::exit::Exit;
use super::options::RigOptions;
use super::screen;
use crate::config::Setup;
use crate::control::{ControlError, Found, RigKey, find};

/// Loads a rig file and looks who runs a session of that bench. What cannot be looked at is told and taken for
/// nobody: a device may still be asked, or stopped, by its port. On failure the error has been printed.
pub(super) fn load_and_find(rig: &RigOptions) -> Result<(Setup, Found), Exit> {
    let setup = crate::config::load(&rig.rig, None, &rig.overrides.set).map_err(|e| {
        screen::error(e);
        Exit::Refused
    })?;
    let found = find(&RigKey::new(&setup.rig, &rig.rig)).unwrap_or_else(|e| {
        screen::warning(e);
        Found::default()
    });
    Ok((setup, found))
}

/// Sessions that do not answer may be this rig's: that is no success.
pub(super) fn tell_mute(mute: &[ControlError]) -> Exit {
    mute.iter().for_each(screen::error);
    if mute.is_empty() { Exit::Done } else { Exit::Failed }
}
