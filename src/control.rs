//! The control socket: how other programs reach a session that runs.
//!
//! Serial ports are opened for one alone, so a second program can neither look at the devices of a running session
//! nor stop them; it asks the session to. Every command that holds a bench (`collect`, `drive`, `jog`, ...)
//! answers on a Unix socket of its own ([`place`]), in JSON, one line each way ([`message`]). The answers come
//! from a thread of their own ([`server`]), which looks at the devices as observers do and raises the stop switch
//! itself: it waits for no executor, no queue and no simulation.
//!
//! Which session is meant is found by asking all of them ([`client`]): the one that has a port of the rig, or, on a
//! virtual bench, the ones that were started with the rig file. Who may ask is a matter of the folder, which only
//! its owner can enter.
//!
//! What this module does not do: open ports, print, or decide what a stop means.

pub mod client;
pub mod message;
pub mod place;
pub mod server;

pub use client::{Found, find};
pub use message::{Answer, Request, RigKey, Status};
pub use server::{Board, Server};

/// Why a session cannot be reached, or cannot be reachable.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The folder of the sockets is not ours alone.
    #[error(
        "the folder of control sockets {path} {why}; set XDG_RUNTIME_DIR to a folder that only you can enter"
    )]
    Folder {
        /// The folder.
        path: String,
        /// What is wrong with it.
        why: String,
    },
    /// The socket cannot be made.
    #[error("the control socket {path} cannot be made: {why}")]
    Listen {
        /// Its path.
        path: String,
        /// The system's words.
        why: String,
    },
    /// A session is there and does not answer.
    #[error(
        "the session with process id {pid} does not answer: {why}; stop it with `kill -TERM {pid}`, or switch the devices off"
    )]
    Mute {
        /// Its process.
        pid: u32,
        /// What was tried.
        why: String,
    },
    /// The system has no such sockets.
    #[error("control sockets need a Unix system; stop the session with Ctrl-C in its own terminal")]
    NoSockets,
}
