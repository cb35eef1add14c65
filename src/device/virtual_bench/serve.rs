//! Serving an emulator over a stream of bytes.
//!
//! [`serve`] works on anything that reads and writes: one end of `tokio::io::duplex` in tests, the
//! master side of a pseudo-terminal ([`pty`]) for the virtual bench and for other people's clients.
//! All time comes from the bench's clock, so a fast bench shortens every delay and skips none.

pub mod pty;

use super::faults::Faulty;
use crate::clock::{Clock, Timestamp};
use std::future::pending;
use std::io;
use std::sync::{Arc, Mutex};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

/// A device that is being served and can still be asked and broken.
pub type SharedDevice = Arc<Mutex<Faulty>>;

/// Why serving ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The client hung up.
    HungUp,
    /// A fault pulled the cable.
    Unplugged,
}

/// Passes bytes between a stream and a device until the client hangs up or the cable is pulled.
/// Dropping the future stops it at once; the device keeps its state and can be served again.
pub async fn serve<S>(stream: S, device: &SharedDevice, clock: Clock) -> io::Result<Ended>
where
    S: AsyncRead + AsyncWrite,
{
    let (mut from_client, mut to_client) = tokio::io::split(stream);
    let mut buffer = [0u8; 512];
    loop {
        let (replies, wake, unplugged) =
            with(device, |d| (d.poll(clock.now()), d.next_deadline(), d.is_unplugged()));
        for reply in replies {
            // A client that hung up makes this fail; what it had sent is still read below.
            if to_client.write_all(&reply).await.is_err() {
                return Ok(Ended::HungUp);
            }
            to_client.flush().await.ok();
        }
        if unplugged {
            return Ok(Ended::Unplugged);
        }
        let alarm = async {
            match wake {
                Some(at) => sleep_to(&clock, at).await,
                None => pending().await,
            }
        };
        tokio::select! {
            read = from_client.read(&mut buffer) => match read {
                Ok(0) => return Ok(Ended::HungUp),
                Ok(n) => with(device, |d| d.receive(&buffer[..n], clock.now())),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            },
            () = alarm => {}
        }
    }
}

/// Runs `f` on the device.
pub fn with<T>(device: &SharedDevice, f: impl FnOnce(&mut Faulty) -> T) -> T {
    f(&mut device.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// Sleeps until `at` has surely been reached: timers round to milliseconds, clocks do not.
async fn sleep_to(clock: &Clock, at: Timestamp) {
    clock.sleep_until(at).await;
    if clock.now() < at {
        clock.sleep(at.since(clock.now()).max(std::time::Duration::from_micros(1))).await;
    }
}

#[cfg(test)]
mod tests {
    use super::super::faults::{FaultKind, FaultPlan, Faulty, Trigger};
    use super::super::firmware::{Emulator, EmulatorOptions};
    use super::super::world::World;
    use super::*;
    use std::collections::BTreeMap;
    use std::time::Duration;
    use tokio::io::{AsyncBufReadExt, BufReader};

    fn grbl(clock: Clock, plan: FaultPlan) -> SharedDevice {
        let text = include_str!("../../../firmware_protocols/grbl.toml");
        let spec = crate::protocol::Spec::parse("grbl", text).unwrap().emulator.unwrap();
        let (now, options) = (clock.now(), EmulatorOptions::default());
        let emulator = Emulator::new(&spec, "stage", &BTreeMap::new(), &options, World::without_pad(), now);
        Arc::new(Mutex::new(Faulty::new(emulator.unwrap(), plan, now)))
    }

    async fn ask(
        client: &mut BufReader<impl tokio::io::AsyncRead + AsyncWrite + Unpin>,
        line: &str,
    ) -> String {
        client.get_mut().write_all(line.as_bytes()).await.unwrap();
        let mut reply = String::new();
        client.read_line(&mut reply).await.unwrap();
        reply.trim_end().to_owned()
    }

    #[tokio::test(start_paused = true)]
    async fn a_move_takes_its_time_on_the_bench_clock_at_any_speed() {
        for speed in [1.0, 8.0] {
            let clock = Clock::with_speed(speed);
            let device = grbl(clock, FaultPlan::none());
            let (near, far) = tokio::io::duplex(4096);
            let session = async {
                let mut client = BufReader::new(near);
                let mut banner = String::new();
                client.read_line(&mut banner).await.unwrap();
                client.read_line(&mut banner).await.unwrap();
                assert_eq!(banner, "\r\nGrbl 1.1h ['$' for help]\r\n");
                let (t0, wall0) = (clock.now(), tokio::time::Instant::now());
                assert_eq!(ask(&mut client, "G1 X-10 F300\n").await, "ok");
                assert!(clock.now().since(t0) < Duration::from_millis(10));
                assert_eq!(ask(&mut client, "G4 P0.01\n").await, "ok");
                // 10 mm at 5 mm/s with 10 mm/s^2: 2.5 s.
                let took = clock.now().since(t0).as_secs_f64();
                assert!((took - 2.51).abs() < 0.02, "{took}");
                let wall = wall0.elapsed().as_secs_f64();
                assert!((wall * speed - took).abs() < 0.03 * speed, "{wall}");
                assert!(ask(&mut client, "?").await.starts_with("<Idle|MPos:-10.000,0.000,0.000|FS:0,0"));
            };
            let (ended, ()) = tokio::join!(serve(far, &device, clock), session);
            assert_eq!(ended.unwrap(), Ended::HungUp);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_pulled_cable_ends_the_service() {
        let clock = Clock::real_time();
        let device = grbl(clock, FaultPlan::one(Trigger::After(Duration::from_secs(1)), FaultKind::Unplug));
        let (near, far) = tokio::io::duplex(4096);
        let ended = serve(far, &device, clock).await.unwrap();
        drop(near);
        assert_eq!(ended, Ended::Unplugged);
    }
}
