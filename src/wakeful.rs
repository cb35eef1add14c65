//! Threads of the pool that stay awake.
//!
//! A thread of the pool that finds nothing to do falls asleep after some ten microseconds, and waking it takes as long again, on a
//! virtual machine fifty. Work that comes in pieces of a hundred microseconds, with what one thread does alone in
//! between, so hardly gains by a second thread. While such work lasts, the others go on looking for pieces of it.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Most threads that are kept awake beside the one that works: pieces of a hundred microseconds feed no more.
const MOST: usize = 7;
/// How long a thread that has come waits for the others.
const WAIT_FOR_OTHERS: Duration = Duration::from_micros(200);

thread_local! {
    /// How many pieces of work, one inside the other, this thread is to come back to.
    static AT_WORK: Cell<usize> = const { Cell::new(0) };
}

/// Does some work whose parallel pieces are short on a thread of the pool, the others staying awake meanwhile. (From a
/// thread that is none of the pool's, every piece would wait for one to wake.)
pub fn wakeful<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    if rayon::current_thread_index().is_none() {
        return rayon::scope(|_| wakeful(work));
    }
    let wanted = (rayon::current_num_threads() - 1).min(MOST);
    let helpers = Arc::new(Helpers { wanted, come: AtomicUsize::new(0), done: AtomicBool::new(false) });
    for _ in 0..wanted {
        let helpers = Arc::clone(&helpers);
        rayon::spawn(move || helpers.stay_awake());
    }
    let _until_done = UntilDone::begin(helpers);
    work()
}

/// The threads that stay awake for one piece of work.
struct Helpers {
    wanted: usize,
    come: AtomicUsize,
    done: AtomicBool,
}

impl Helpers {
    /// Takes what pieces there are until the work is done. A thread that is at work itself, and has come here while it waits
    /// for a piece of that, goes back at once.
    fn stay_awake(&self) {
        let come = self.come.fetch_add(1, Ordering::Relaxed) + 1;
        // The first to come would else take the calls of all others and stay awake alone.
        let (begun, mut come) = (Instant::now(), come);
        while come < self.wanted && begun.elapsed() < WAIT_FOR_OTHERS && !self.is_over() {
            std::thread::yield_now();
            come = self.come.load(Ordering::Relaxed);
        }
        while !self.is_over() {
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                // Whoever else wants the core may have it.
                std::thread::yield_now();
            }
        }
    }

    fn is_over(&self) -> bool {
        self.done.load(Ordering::Relaxed) || AT_WORK.get() > 0
    }
}

/// Lets the others sleep when it is dropped.
struct UntilDone(Arc<Helpers>);

impl UntilDone {
    fn begin(helpers: Arc<Helpers>) -> Self {
        AT_WORK.set(AT_WORK.get() + 1);
        Self(helpers)
    }
}

impl Drop for UntilDone {
    fn drop(&mut self) {
        AT_WORK.set(AT_WORK.get() - 1);
        self.0.done.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    fn pool(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
    }

    fn sum() -> u64 {
        (0..1000u64).into_par_iter().map(|k| k * k).sum()
    }

    #[test]
    fn work_within_work_on_every_thread_comes_to_its_end() {
        for threads in [1, 2, 5] {
            let sums: Vec<u64> = pool(threads).install(|| {
                let all = (0..40).into_par_iter();
                all.map(|_| wakeful(|| wakeful(sum) + (0..20).map(|_| sum()).sum::<u64>())).collect()
            });
            assert!(sums.iter().all(|s| *s == 21 * 332_833_500));
        }
        assert_eq!(wakeful(sum), 332_833_500);
    }

    #[test]
    fn a_panic_lets_the_others_sleep_and_leaves_the_thread_free() {
        let one = pool(1);
        let failing = || one.install(|| wakeful::<()>(|| panic!("on purpose")));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(failing)).is_err());
        assert_eq!(one.install(|| AT_WORK.get()), 0);
        let helpers =
            Arc::new(Helpers { wanted: 0, come: AtomicUsize::new(0), done: AtomicBool::new(false) });
        let failing = || {
            let _until_done = UntilDone::begin(Arc::clone(&helpers));
            panic!("on purpose")
        };
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(failing)).is_err());
        assert!(helpers.done.load(Ordering::Relaxed));
        // Else this would not come back.
        helpers.stay_awake();
    }
}
