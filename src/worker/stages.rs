//! Time that a job spends in each stage, measured from its progress reports.

use std::time::{Duration, Instant};

use crate::telemetry::series::stage_label;

/// The stages of one job so far.
#[derive(Debug, Default)]
pub(super) struct StageTimes {
    current: Option<(&'static str, Instant)>,
    spent: Vec<(&'static str, Duration)>,
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

    fn leave(&mut self, now: Instant) {
        let Some((stage, since)) = self.current.take() else { return };
        let time = now.saturating_duration_since(since);
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
        let seconds = |(stage, time): (&'static str, Duration)| (stage, time.as_secs());
        let spent: Vec<_> = times.end(at(10)).into_iter().map(seconds).collect();
        assert_eq!(spent, [("reading", 2), ("fusing", 7), ("masking", 1)]);
        assert!(times.end(at(11)).is_empty());
    }
}
