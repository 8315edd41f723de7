//! One fraction for the whole job, from the steps of its stages.

use std::sync::Mutex;

use super::Watcher;
use crate::contract::Progress;
use pinstack_science::types::{Cancelled, Control};

/// A stage that the science reports, and its share of the phase.
pub type Stage = (&'static str, f64);

/// A stretch of a job, from `from` to `to` of its fraction, with the stages that make it up. It is the [`Control`] of the
/// science in that stretch. The fraction that it reports never goes back, whatever the order of the reports.
pub struct Phase<'a> {
    watcher: &'a dyn Watcher,
    stages: &'a [Stage],
    from: f64,
    to: f64,
    reached: Mutex<f64>,
}

impl<'a> Phase<'a> {
    /// The stretch from `from` to `to` (0..1); the shares of the stages need not add up to anything.
    pub fn new(watcher: &'a dyn Watcher, stages: &'a [Stage], from: f64, to: f64) -> Self {
        Self { watcher, stages, from, to, reached: Mutex::new(from) }
    }

    /// The share of this phase that is done when `done` (0..1) of `stage` is. A stage that is not in the list counts as
    /// not yet begun.
    fn share(&self, stage: &str, done: f64) -> f64 {
        let total: f64 = self.stages.iter().map(|(_, share)| share).sum();
        let Some(place) = self.stages.iter().position(|(name, _)| *name == stage) else { return 0.0 };
        let before: f64 = self.stages.iter().take(place).map(|(_, share)| share).sum();
        let own = self.stages.get(place).map_or(0.0, |(_, share)| share * done);
        if total > 0.0 { (before + own) / total } else { 0.0 }
    }
}

impl Control for Phase<'_> {
    fn progress(&self, stage: &'static str, completed: usize, total: usize) {
        let done = if total == 0 { 1.0 } else { (completed as f64 / total as f64).clamp(0.0, 1.0) };
        let fraction = self.from + (self.to - self.from) * self.share(stage, done);
        // a panic elsewhere cannot leave a number half written
        let mut reached = self.reached.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *reached = reached.max(fraction);
        self.watcher.report(Progress {
            stage: stage.to_owned(),
            completed: u32::try_from(completed).unwrap_or(u32::MAX),
            total: u32::try_from(total).unwrap_or(u32::MAX),
            fraction: *reached,
        });
    }

    fn check(&self) -> Result<(), Cancelled> {
        self.watcher.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Seen(Mutex<Vec<f64>>);

    impl Watcher for Seen {
        fn report(&self, progress: Progress) {
            self.0.lock().unwrap().push(progress.fraction);
        }
        fn check(&self) -> Result<(), Cancelled> {
            Ok(())
        }
    }

    #[test]
    fn the_fraction_goes_from_end_to_end_and_never_back() {
        let seen = Seen::default();
        let stages = [("aligning", 3.0), ("fusing", 1.0)];
        let phase = Phase::new(&seen, &stages, 0.25, 0.75);
        for completed in [0, 2, 1, 4] {
            phase.progress("aligning", completed, 4);
        }
        phase.progress("something else", 1, 9);
        phase.progress("fusing", 1, 2);
        phase.progress("fusing", 2, 2);
        assert_eq!(*seen.0.lock().unwrap(), [0.25, 0.4375, 0.4375, 0.625, 0.625, 0.6875, 0.75]);
    }

    #[test]
    fn a_stage_without_steps_is_done_at_once() {
        let seen = Seen::default();
        Phase::new(&seen, &[("reading", 1.0)], 0.0, 0.5).progress("reading", 0, 0);
        assert_eq!(*seen.0.lock().unwrap(), [0.5]);
    }
}
