//! Which step of the first pass a thread does next.
//!
//! A slice is decoded by one thread, and then processed in bands by all threads that are free. Each decoded slice costs
//! memory, so there are fewer of them than threads. All threads are busy only if some decode while the others process
//! bands, so decoding comes first, and bands come from the slice that was decoded first: slices are then finished one
//! after the other, and the next ones are decoded meanwhile. If threads took bands from any slice, all slices would be
//! finished at about the same time, and half of the threads would wait while the next ones are decoded.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex},
};

use crate::{
    fusion::lock::{locked, unlocked},
    types::Interrupted,
};

/// A step of the first pass. `T` is a decoded slice.
pub(super) enum Step<T> {
    /// Decode the slice with this index.
    Decode(usize),
    /// Process this band of a decoded slice.
    Band(Arc<T>, usize),
}

/// The steps of all slices.
pub(super) struct Schedule<T> {
    slices: usize,
    /// Most slices in memory at a time.
    places: usize,
    state: Mutex<State<T>>,
}

struct State<T> {
    /// The next slice to decode.
    next: usize,
    /// Slices in memory, and those that are being decoded.
    in_flight: usize,
    /// Slices with bands that no thread has taken yet, in the order in which they were decoded, and these bands.
    decoded: VecDeque<(Arc<T>, std::ops::Range<usize>)>,
    /// The error of the failed slice with the lowest index.
    failure: Option<(usize, Interrupted)>,
}

impl<T> Schedule<T> {
    /// The steps of `slices` slices, of which at most `places` are in memory at a time.
    pub(super) fn new(slices: usize, places: usize) -> Self {
        let state = State { next: 0, in_flight: 0, decoded: VecDeque::new(), failure: None };
        Self { slices, places, state: Mutex::new(state) }
    }

    /// The next step; none if there is nothing to do at the moment, or if a step has failed.
    pub(super) fn next(&self) -> Option<Step<T>> {
        let state = &mut *locked(&self.state);
        if state.failure.is_some() {
            return None;
        }
        if state.next < self.slices && state.in_flight < self.places {
            state.in_flight += 1;
            state.next += 1;
            return Some(Step::Decode(state.next - 1));
        }
        let (slice, mut bands) = state.decoded.pop_front()?;
        let band = bands.next()?;
        if bands.is_empty() {
            // the queue gives up the slice, so that the thread that finishes its last band can take it
            return Some(Step::Band(slice, band));
        }
        state.decoded.push_front((slice.clone(), bands));
        Some(Step::Band(slice, band))
    }

    /// Adds the `bands` (at least one) bands of a decoded slice.
    pub(super) fn decoded(&self, slice: T, bands: usize) {
        locked(&self.state).decoded.push_back((Arc::new(slice), 0..bands));
    }

    /// Says that a slice is no longer in memory.
    pub(super) fn freed(&self) {
        locked(&self.state).in_flight -= 1;
    }

    /// Says that a step of slice `slice` has failed: no further steps are given.
    pub(super) fn failed(&self, slice: usize, stop: Interrupted) {
        let failure = &mut locked(&self.state).failure;
        if failure.as_ref().is_none_or(|(other, _)| slice < *other) {
            *failure = Some((slice, stop));
        }
    }

    /// The result of all steps.
    ///
    /// # Errors
    /// The error of the failed slice with the lowest index.
    pub(super) fn finish(self) -> Result<(), Interrupted> {
        unlocked(self.state).failure.map_or(Ok(()), |(_, stop)| Err(stop))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::Cancelled;

    /// The next step in words.
    fn next(schedule: &Schedule<&'static str>) -> String {
        match schedule.next() {
            None => "nothing".to_owned(),
            Some(Step::Decode(slice)) => format!("decode {slice}"),
            Some(Step::Band(slice, band)) => format!("{slice} {band}"),
        }
    }

    #[test]
    fn decoding_comes_first_and_then_the_slice_that_was_decoded_first() {
        let schedule = Schedule::new(3, 2);
        assert_eq!([next(&schedule), next(&schedule), next(&schedule)], ["decode 0", "decode 1", "nothing"]);
        schedule.decoded("one", 2);
        schedule.decoded("zero", 2);
        assert_eq!([next(&schedule), next(&schedule)], ["one 0", "one 1"]);
        schedule.freed();
        assert_eq!([next(&schedule), next(&schedule)], ["decode 2", "zero 0"]);
        schedule.decoded("two", 1);
        assert_eq!([next(&schedule), next(&schedule), next(&schedule)], ["zero 1", "two 0", "nothing"]);
        schedule.finish().expect("nothing failed");
    }

    #[test]
    fn the_last_band_of_a_slice_owns_it() {
        let schedule = Schedule::new(1, 1);
        assert_eq!(next(&schedule), "decode 0");
        schedule.decoded("zero", 2);
        let steps = [schedule.next(), schedule.next()].map(|step| match step {
            Some(Step::Band(slice, _)) => slice,
            _ => panic!("a band"),
        });
        assert_eq!(steps.map(Arc::into_inner), [None, Some("zero")]);
    }

    #[test]
    fn after_a_failure_nothing_is_begun_and_the_lowest_slice_is_blamed() {
        let schedule = Schedule::<&str>::new(4, 2);
        assert_eq!([next(&schedule), next(&schedule)], ["decode 0", "decode 1"]);
        schedule.failed(1, Interrupted::Cancelled(Cancelled));
        schedule.decoded("zero", 3);
        assert_eq!(next(&schedule), "nothing");
        schedule
            .failed(0, crate::types::Error::new(crate::types::ErrorKind::InvalidImage, "the slice is black").into());
        schedule.failed(2, Interrupted::Cancelled(Cancelled));
        let stop = schedule.finish().expect_err("three slices failed");
        assert!(matches!(&stop, Interrupted::Failed(error) if error.detail == "the slice is black"), "{stop:?}");
    }
}
