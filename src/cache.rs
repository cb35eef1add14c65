//! Where things are kept between runs: the cache folder of this user.
//!
//! `TWINRIG_CACHE` names it (set to nothing: nothing is kept); else it is `twinrig` in the platform's own cache folder. Nothing
//! in it is needed: whoever deletes it loses time, not data.

mod store;

pub use store::{Kind, Store};

use std::path::PathBuf;

/// The cache folder; None when it is switched off or the user has none. It is for whoever puts the program together
/// (`assemble`, `config`) to ask: domains are told where they may keep things.
pub fn folder() -> Option<PathBuf> {
    let variable = |name: &str| std::env::var_os(name).map(PathBuf::from);
    match variable("TWINRIG_CACHE") {
        Some(own) => (!own.as_os_str().is_empty()).then_some(own),
        None => platform(&variable).map(|cache| cache.join("twinrig")),
    }
}

/// Where this system keeps caches. Relative paths are none (the XDG Base Directory Specification wants them ignored).
fn platform(variable: &impl Fn(&str) -> Option<PathBuf>) -> Option<PathBuf> {
    let set = |name: &str| variable(name).filter(|path| path.is_absolute());
    if cfg!(windows) {
        return set("LOCALAPPDATA");
    }
    let home = || set("HOME");
    let usual = if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" };
    set("XDG_CACHE_HOME").or_else(|| home().map(|home| home.join(usual)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cache_follows_xdg_and_home() {
        let of = |pairs: &[(&str, &str)]| {
            let pairs: Vec<(String, PathBuf)> =
                pairs.iter().map(|(k, v)| ((*k).to_owned(), PathBuf::from(v))).collect();
            platform(&|name: &str| pairs.iter().find(|(k, _)| k == name).map(|(_, v)| v.clone()))
        };
        if cfg!(target_os = "linux") {
            assert_eq!(of(&[("XDG_CACHE_HOME", "/c"), ("HOME", "/h")]), Some(PathBuf::from("/c")));
            assert_eq!(of(&[("XDG_CACHE_HOME", "c"), ("HOME", "/h")]), Some(PathBuf::from("/h/.cache")));
            assert_eq!(of(&[]), None);
        }
    }
}
