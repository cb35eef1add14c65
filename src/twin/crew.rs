//! The cores a twin works on, and how paths that are walked at the same time share them.
//!
//! A quasi-static increment is many short passes over a small grid, which a second core helps less than it helps a second
//! path: two side by side keep two cores busy. So each walker has a core of its own, until so few
//! are left that those together do not use half of the cores: then each step may use them all. What is computed does not
//! depend on it: solvers and pictures are the same to the bit for any number of threads.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// Threads of a twin. They give way: whoever drives motors and cameras comes first.
#[derive(Debug)]
pub struct Crew {
    all: ThreadPool,
    single: Vec<ThreadPool>,
}

impl Crew {
    /// A crew of so many threads, or as many as there are cores.
    ///
    /// # Errors
    /// When the system refuses threads.
    pub fn new(threads: Option<u32>) -> Result<Self, ThreadPoolBuildError> {
        let all = pool(threads.map_or(0, |n| n as usize), "twin")?;
        let alone = |k| pool(1, &format!("twin-walk-{k}"));
        // One thread alone shares with nobody.
        let walkers = if all.current_num_threads() > 1 { all.current_num_threads() } else { 0 };
        let single = (0..walkers).map(alone).collect::<Result<_, _>>()?;
        Ok(Self { all, single })
    }

    /// How many paths can be walked at the same time.
    pub fn walkers(&self) -> usize {
        self.single.len().max(1)
    }

    /// Does what nobody else works beside.
    pub fn together<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.all.install(work)
    }

    /// Does one step of a walker while `walking` of them are on their way.
    pub(super) fn step<R: Send>(&self, walker: usize, walking: usize, work: impl FnOnce() -> R + Send) -> R {
        let is_roomy = 2 * walking <= self.all.current_num_threads();
        match self.single.get(walker).filter(|_| !is_roomy) {
            Some(own) => own.install(work),
            None => self.all.install(work),
        }
    }
}

fn pool(threads: usize, name: &str) -> Result<ThreadPool, ThreadPoolBuildError> {
    let name = name.to_owned();
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(move |i| format!("{name}-{i}"))
        .start_handler(|_| give_way())
        .build()
}

/// Lowers the priority of the calling thread. A system that refuses leaves it as it was.
fn give_way() {
    #[cfg(target_os = "linux")]
    {
        let thread = rustix::thread::gettid();
        if let Err(e) = rustix::process::setpriority_process(Some(thread), 10) {
            tracing::debug!("a simulation thread keeps its priority: {e}");
        }
    }
}
