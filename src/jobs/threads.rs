//! A thread pool per job.

use std::thread;

use rayon::ThreadPoolBuilder;
use tracing::{Span, dispatcher};

/// Runs `work` in a rayon pool of `threads` threads.
///
/// A pool shared by several jobs is not fair: rayon steals from another job only when a thread has nothing left of its
/// own job, so a small stack would wait for every pass of a large one. With a pool per job the operating system shares
/// the cores between jobs. If no threads can be started, the job uses the pool of the process.
pub(super) fn with_own_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    // the log lines of its threads are those of the job
    let (span, subscriber) = (Span::current(), dispatcher::get_default(Clone::clone));
    let started = ThreadPoolBuilder::new().num_threads(threads).spawn_handler(|thread| {
        let (span, subscriber) = (span.clone(), subscriber.clone());
        let name = format!("job-{}", thread.index());
        let of_job = move || dispatcher::with_default(&subscriber, || span.in_scope(|| thread.run()));
        thread::Builder::new().name(name).spawn(of_job)?;
        Ok(())
    });
    match started.build() {
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
    fn every_thread_of_a_job_is_in_the_span_of_the_job() {
        let subscriber = tracing_subscriber::registry();
        tracing::subscriber::with_default(subscriber, || {
            let job = tracing::info_span!("job");
            let own = job.id().expect("the span is enabled");
            let spans = job.in_scope(|| with_own_threads(2, || rayon::broadcast(|_| Span::current().id())));
            assert_eq!(spans, [Some(own.clone()), Some(own)]);
        });
    }

    #[test]
    fn a_job_runs_with_its_own_number_of_threads() {
        assert_eq!(with_own_threads(3, rayon::current_num_threads), 3);
    }
}
