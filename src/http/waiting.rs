//! How long a request waited for its client or for a job: time in which the server had nothing to do for it.
//!
//! In: the places that wait say so ([`add`]). Out: the sums of one request ([`measured`]). They travel in a task-local, so
//! that a body that is read deep inside a handler need not carry them.

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

/// Runs what answers a request: its output, and the times that it waited.
pub async fn measured<F: Future>(answering: F) -> (F::Output, [(WaitsOn, Duration); 2]) {
    let run = async {
        let output = answering.await;
        (output, WAITED.with(|waited| [WaitsOn::Body, WaitsOn::Job].map(|on| (on, waited.sum(on).get()))))
    };
    WAITED.scope(Waited::default(), run).await
}

/// The request of this task waited. Nothing happens in a task that answers none.
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
    async fn what_a_request_waits_is_its_own_sum() {
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
