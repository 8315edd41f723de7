//! A thread pool per job.

use rayon::ThreadPoolBuilder;

/// Runs `work` in a rayon pool of `threads` threads.
///
/// A pool shared by several jobs is not fair: rayon steals from another job only when a thread has nothing left of its
/// own job, so a small stack would wait for every pass of a large one. With a pool per job the operating system shares
/// the cores between jobs. If no threads can be started, the job uses the pool of the process.
pub(super) fn with_own_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    match ThreadPoolBuilder::new().num_threads(threads).thread_name(|thread| format!("job-{thread}")).build() {
        Ok(pool) => pool.install(work),
        Err(error) => {
            tracing::warn!(%error, "cannot start threads for this job; it shares the thread pool of the process");
            work()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{
        sync::{Barrier, Mutex, mpsc},
        thread,
        time::Duration,
    };

    use rayon::prelude::*;

    use super::*;

    #[test]
    fn a_job_makes_progress_while_another_keeps_all_its_threads_busy() {
        let threads = rayon::current_num_threads();
        let (busy, (over, ends)) = (Barrier::new(threads + 1), mpsc::channel::<()>());
        let ends = Mutex::new(ends);
        thread::scope(|scope| {
            let large = scope.spawn(|| {
                with_own_threads(threads, || {
                    (0..threads).into_par_iter().with_max_len(1).for_each(|_| {
                        busy.wait();
                        let ends = ends.lock().expect("no thread panics with it");
                        ends.recv_timeout(Duration::from_secs(60)).expect("the small job ends");
                    });
                });
            });
            busy.wait();
            let small: usize = with_own_threads(threads, || (0..1000_usize).into_par_iter().sum());
            assert_eq!(small, 499_500);
            (0..threads).for_each(|_| over.send(()).expect("the large job waits"));
            assert!(large.join().is_ok());
        });
    }

    #[test]
    fn a_job_runs_with_its_own_number_of_threads() {
        assert_eq!(with_own_threads(3, rayon::current_num_threads), 3);
    }
}
