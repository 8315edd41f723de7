//! The time that a request waited for its client or for a job, which is no service time.
//!
//! Code that waits calls [`add`]; [`measured`] returns the sums of one request. The sums are task-local, so that code
//! deep inside a handler need not pass them on.

use std::{cell::Cell, time::Duration};

use crate::telemetry::events::WaitsOn;

tokio::task_local! {
    static WAITED: Waited;
}

#[derive(Default)]
struct Waited {
    body: Cell<Duration>,
    job: Cell<Duration>,
}

impl Waited {
    fn sum(&self, on: WaitsOn) -> &Cell<Duration> {
        match on {
            WaitsOn::Body => &self.body,
            WaitsOn::Job => &self.job,
        }
    }
}

/// Runs the future that answers a request. Returns its output and the times that it waited.
pub async fn measured<F: Future>(answering: F) -> (F::Output, [(WaitsOn, Duration); 2]) {
    let run = async {
        let output = answering.await;
        (output, WAITED.with(|waited| [WaitsOn::Body, WaitsOn::Job].map(|on| (on, waited.sum(on).get()))))
    };
    WAITED.scope(Waited::default(), run).await
}

/// Adds a time that the request of this task waited. Does nothing in a task that answers no request.
pub fn add(on: WaitsOn, time: Duration) {
    let _ = WAITED.try_with(|waited| {
        let sum = waited.sum(on);
        sum.set(sum.get().saturating_add(time));
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn wait_times_are_summed_per_request() {
        add(WaitsOn::Body, Duration::from_secs(9));
        let (output, waited) = measured(async {
            add(WaitsOn::Body, Duration::from_secs(1));
            tokio::task::yield_now().await;
            add(WaitsOn::Body, Duration::from_secs(2));
            add(WaitsOn::Job, Duration::from_secs(4));
            "answer"
        })
        .await;
        assert_eq!(output, "answer");
        assert_eq!(waited, [(WaitsOn::Body, Duration::from_secs(3)), (WaitsOn::Job, Duration::from_secs(4))]);
    }
}
