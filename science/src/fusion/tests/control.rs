//! Tests of cancellation and progress.

use std::sync::{
    Mutex,
    atomic::{AtomicUsize, Ordering},
};

use super::*;
use crate::{
    fusion::lock::{locked, unlocked},
    types::Cancelled,
};

/// Cancels after a number of checks, and records the progress.
struct CancelAfter {
    checks: usize,
    done: AtomicUsize,
    steps: Mutex<Vec<(&'static str, usize, usize)>>,
}

impl CancelAfter {
    fn new(checks: usize) -> Self {
        Self { checks, done: AtomicUsize::new(0), steps: Mutex::new(Vec::new()) }
    }
}

impl Control for CancelAfter {
    fn progress(&self, stage: &'static str, completed: usize, total: usize) {
        locked(&self.steps).push((stage, completed, total));
    }

    fn check(&self) -> Result<(), Cancelled> {
        if self.done.fetch_add(1, Ordering::Relaxed) < self.checks { Ok(()) } else { Err(Cancelled) }
    }
}

#[test]
fn a_cancel_stops_the_fusion_at_any_check() {
    let (slices, plan) = unaligned(120, 90, 3);
    let never = CancelAfter::new(usize::MAX);
    let fused =
        |control: &CancelAfter| fuse(&&slices[..], &plan, &FusionRequest::default(), &std::env::temp_dir(), control);
    assert!(fused(&never).is_ok());
    let total = never.done.load(Ordering::Relaxed);
    assert!(total > 10, "only {total} checks");
    for checks in (0..total).step_by(3) {
        assert!(matches!(fused(&CancelAfter::new(checks)), Err(Interrupted::Cancelled(_))));
    }
}

#[test]
fn a_cancel_while_other_threads_work_on_the_same_slice_is_reported_as_a_cancel() {
    // three bands per slice
    let (slices, plan) = unaligned(60, 600, 3);
    let plan = Plan { method: Method::HaloCorrected, ..plan };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    for checks in 0..40 {
        let control = CancelAfter::new(checks);
        let fused =
            pool.install(|| fuse(&&slices[..], &plan, &FusionRequest::default(), &std::env::temp_dir(), &control));
        assert!(matches!(fused, Err(Interrupted::Cancelled(_))), "after {checks} checks");
    }
}

/// The progress of fusing `slices`: (stage, completed, total) of each report.
fn progress_of(slices: &[Raster], plan: &Plan) -> Vec<(&'static str, usize, usize)> {
    let control = CancelAfter::new(usize::MAX);
    fuse(&slices, plan, &FusionRequest::default(), &std::env::temp_dir(), &control).unwrap();
    unlocked(control.steps)
}

#[test]
fn progress_increases_to_the_end_of_each_stage() {
    let (slices, plan) = unaligned(120, 90, 4);
    let steps = progress_of(&slices, &plan);
    let aligning: Vec<_> = steps.iter().filter(|step| step.0 == "aligning").map(|step| step.1).collect();
    assert_eq!(aligning, [0, 1, 2, 3, 4]);
    let last = steps.last().unwrap();
    assert_eq!((last.0, last.1), ("fusing", last.2));
    assert!(steps.windows(2).all(|pair| pair[0].0 != pair[1].0 || pair[0].1 < pair[1].1));
}

#[test]
fn every_method_reports_its_stages_in_order() {
    let (slices, plan) = unaligned(120, 90, 4);
    for method in Method::ALL {
        let plan = Plan { method, near_first: Some(true), ..plan.clone() };
        let mut stages: Vec<&str> = progress_of(&slices, &plan).into_iter().map(|step| step.0).collect();
        stages.dedup();
        // halo-corrected fusion ends with the pyramid image if it cannot measure the blur
        let expected = method.progress_stages().iter().map(|stage| stage.0).take(stages.len());
        assert!(stages.len() >= 2 && stages.iter().copied().eq(expected), "{method:?}: {stages:?}");
    }
}
