//! Time that a job spends in each stage, measured from its progress reports.
//!
//! Metrics get the sum per stage, traces each visit of a stage.

use std::time::{Duration, Instant};

use crate::telemetry::series::stage_label;

/// Most visits that are kept: a job of many short stages must not fill the queue of the spans.
const MOST_VISITS: usize = 64;

/// One visit of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Visit {
    pub(super) stage: &'static str,
    pub(super) from: Instant,
    pub(super) to: Instant,
}

/// The stages of one job so far.
#[derive(Debug, Default)]
pub(super) struct StageTimes {
    current: Option<(&'static str, Instant)>,
    spent: Vec<(&'static str, Duration)>,
    visits: Vec<Visit>,
}

impl StageTimes {
    /// The job is in `stage` at `now`. Cheap when the stage has not changed.
    pub(super) fn enter(&mut self, stage: &str, now: Instant) {
        let label = stage_label(stage);
        if self.current.is_none_or(|(before, _)| before != label) {
            self.leave(now);
            self.current = Some((label, now));
        }
    }

    /// The job ended at `now`. Returns its stages in the order in which they were first entered. A stage that was
    /// entered several times appears once, with the sum.
    pub(super) fn end(&mut self, now: Instant) -> Vec<(&'static str, Duration)> {
        self.leave(now);
        std::mem::take(&mut self.spent)
    }

    /// The stages that were entered and left, in this order; the current one until `now`.
    pub(super) fn visits(&self, now: Instant) -> Vec<Visit> {
        let current = self.current.map(|(stage, from)| Visit { stage, from, to: now });
        self.visits.iter().copied().chain(current).collect()
    }

    fn leave(&mut self, now: Instant) {
        let Some((stage, since)) = self.current.take() else { return };
        let time = now.saturating_duration_since(since);
        if self.visits.len() < MOST_VISITS {
            self.visits.push(Visit { stage, from: since, to: now });
        }
        match self.spent.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, sum)) => *sum += time,
            None => self.spent.push((stage, time)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_that_is_entered_twice_is_listed_once_with_the_sum() {
        let (mut times, begin) = (StageTimes::default(), Instant::now());
        let at = |seconds| begin + Duration::from_secs(seconds);
        for (stage, seconds) in [("reading", 0), ("reading", 1), ("fusing", 2), ("masking", 5), ("fusing", 6)] {
            times.enter(stage, at(seconds));
        }
        let visits: Vec<_> = times.visits(at(7)).iter().map(|visit| (visit.stage, visit.to - visit.from)).collect();
        let second = Duration::from_secs(1);
        assert_eq!(visits, [("reading", 2 * second), ("fusing", 3 * second), ("masking", second), ("fusing", second)]);
        let seconds = |(stage, time): (&'static str, Duration)| (stage, time.as_secs());
        let spent: Vec<_> = times.end(at(10)).into_iter().map(seconds).collect();
        assert_eq!(spent, [("reading", 2), ("fusing", 7), ("masking", 1)]);
        assert!(times.end(at(11)).is_empty());
    }
}
