//! Progress of a whole job: turns the progress of each stage into one fraction from 0 to 1.

use std::sync::Mutex;

use super::ProgressSink;
use crate::contract::Progress;
use pinstack_science::types::{Cancelled, Control};

/// Name of a stage as the science reports it, and its weight within the phase.
pub type Stage = (&'static str, f64);

/// One phase of a job: the interval `from..to` of the job's fraction and the stages within it. It is the [`Control`]
/// that the science gets in that phase. The reported fraction never decreases, whatever the order of the reports.
pub struct Phase<'a> {
    sink: &'a dyn ProgressSink,
    stages: &'a [Stage],
    from: f64,
    to: f64,
    reached: Mutex<f64>,
}

impl<'a> Phase<'a> {
    /// A phase from `from` to `to` (0..1). The weights of its stages need not add up to 1.
    pub fn new(sink: &'a dyn ProgressSink, stages: &'a [Stage], from: f64, to: f64) -> Self {
        Self { sink, stages, from, to, reached: Mutex::new(from) }
    }

    /// Fraction of this phase that is done when `done` (0..1) of `stage` is done. 0 for an unknown stage.
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
        // poisoning is harmless: a panic cannot leave a number half written
        let mut reached = self.reached.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        *reached = reached.max(fraction);
        self.sink.report(Progress {
            stage: stage.to_owned(),
            completed: u32::try_from(completed).unwrap_or(u32::MAX),
            total: u32::try_from(total).unwrap_or(u32::MAX),
            fraction: *reached,
        });
    }

    fn check(&self) -> Result<(), Cancelled> {
        self.sink.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Recorder(Mutex<Vec<f64>>);

    impl ProgressSink for Recorder {
        fn report(&self, progress: Progress) {
            self.0.lock().unwrap().push(progress.fraction);
        }
        fn check(&self) -> Result<(), Cancelled> {
            Ok(())
        }
    }

    #[test]
    fn the_fraction_covers_its_interval_and_never_decreases() {
        let recorder = Recorder::default();
        let stages = [("aligning", 3.0), ("fusing", 1.0)];
        let phase = Phase::new(&recorder, &stages, 0.25, 0.75);
        for completed in [0, 2, 1, 4] {
            phase.progress("aligning", completed, 4);
        }
        phase.progress("something else", 1, 9);
        phase.progress("fusing", 1, 2);
        phase.progress("fusing", 2, 2);
        assert_eq!(*recorder.0.lock().unwrap(), [0.25, 0.4375, 0.4375, 0.625, 0.625, 0.6875, 0.75]);
    }

    #[test]
    fn a_stage_without_steps_is_done_at_once() {
        let recorder = Recorder::default();
        Phase::new(&recorder, &[("reading", 1.0)], 0.0, 0.5).progress("reading", 0, 0);
        assert_eq!(*recorder.0.lock().unwrap(), [0.5]);
    }
}
