//! `twinrig devices`: what is connected.
//!
//! Lists serial ports with their USB identity and stable path, and cameras with their formats and
//! controls, in the words that a rig file takes. Nothing is opened for writing and nothing moves.

use super::exit::Exit;
use super::screen;
use crate::device::camera::list::{self, CameraListing};
use crate::device::port::{self, PortInfo};
use serde::Serialize;

/// List serial ports and cameras
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  twinrig devices\n  twinrig devices --json")]
pub struct Args {
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Everything that is connected.
#[derive(Debug, Serialize)]
struct Connected {
    ports: Vec<PortInfo>,
    cameras: Vec<CameraListing>,
}

impl Args {
    /// Runs the subcommand.
    pub fn run(self) -> Exit {
        let connected = Connected { ports: port::list(), cameras: list::list() };
        if self.json {
            screen::json(&connected);
            return Exit::Done;
        }
        screen::result(format_args!("serial ports: {}", connected.ports.len()));
        for port in &connected.ports {
            let stable = port.by_id.as_ref().unwrap_or(&port.path);
            screen::result(format_args!("  {}  {}", stable.display(), port.product.as_deref().unwrap_or("")));
            if let Some(usb) = &port.usb {
                let serial = usb.serial.as_ref().map(|s| format!(", serial = \"{s}\"")).unwrap_or_default();
                screen::result(format_args!(
                    "    port = {{ vid = \"{}\", pid = \"{}\"{serial} }}",
                    usb.vid, usb.pid
                ));
            }
        }
        screen::result(format_args!("cameras: {}", connected.cameras.len()));
        for camera in &connected.cameras {
            screen::result(camera);
        }
        Exit::Done
    }
}
