//! The threads of a job.

use rayon::ThreadPoolBuilder;

/// Does `work` with `threads` threads of its own.
///
/// Jobs that share one pool do not share it fairly: a thread goes over to another job only when its own has nothing
/// left to hand out, so that a small stack would wait for all passes of a large one. With threads of their own the
/// operating system gives each job its part of the cores. Where no threads can be had, jobs share those of the process.
pub(super) fn with_own_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    match ThreadPoolBuilder::new().num_threads(threads).thread_name(|thread| format!("job-{thread}")).build() {
        Ok(pool) => pool.install(work),
        Err(error) => {
            tracing::warn!(%error, "no threads can be had for this job alone; it shares those of the process");
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
    fn a_job_goes_on_while_another_keeps_all_its_threads_busy() {
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
    fn a_job_sees_the_threads_that_it_was_given() {
        assert_eq!(with_own_threads(3, rayon::current_num_threads), 3);
    }
}
