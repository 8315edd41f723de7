//! How many slices are in memory at a time.

/// Most slices that are decoded or in memory at a time: each costs memory.
const MAX_IN_FLIGHT: usize = 4;

/// Number of slices that [`fuse`](super::fuse) decodes or has in memory at the same time with `threads` threads: half
/// of the threads decode, because that takes less than half of the time of a slice, and the other half processes one
/// more slice.
pub fn slices_in_flight(threads: usize, slices: usize) -> usize {
    (threads / 2 + 1).min(MAX_IN_FLIGHT).min(slices).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_threads_decode_and_there_are_never_more_slices_in_memory_than_four() {
        let in_flight = [1, 2, 4, 6, 8, 64].map(|threads| slices_in_flight(threads, 20));
        assert_eq!(in_flight, [1, 2, 3, 4, 4, 4]);
        assert_eq!([slices_in_flight(8, 1), slices_in_flight(8, 3)], [1, 3]);
    }
}
