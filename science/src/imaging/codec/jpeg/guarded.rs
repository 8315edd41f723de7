//! A JPEG whose end marker is replaced, so that a decoder that needs more data than there are is noticed.

use std::borrow::Cow;

/// Marker of the end of the picture.
pub(super) const EOI: u8 = 0xD9;

/// Repetitions of the guard: at least 256 bits.
const REPETITIONS: usize = 32;

/// Bytes that are appended to the file: the guard and an end marker.
pub(in super::super) const APPENDED: usize = 2 * REPETITIONS + 2;

/// What replaces the end marker.
#[derive(Clone, Copy)]
pub(super) enum Guard {
    /// No Huffman table has a code of all ones (ITU T.81, annex C), so a decoder that reads them fails instead of
    /// inventing the rest of the picture. A complete scan is decoded without reading them.
    Ones,
    Zeros,
}

/// A file with a guard in place of the end marker.
pub(super) struct Guarded {
    bytes: Vec<u8>,
    /// Where the end marker was.
    end: usize,
}

impl Guarded {
    /// The file whose end marker is at `end`. Owned bytes with room for [`APPENDED`] more are not copied.
    pub(super) fn new(file: Cow<'_, [u8]>, end: usize) -> Self {
        let bytes = match file {
            Cow::Owned(mut bytes) => {
                bytes.truncate(end);
                bytes.reserve_exact(APPENDED);
                bytes
            }
            Cow::Borrowed(file) => {
                let mut bytes = Vec::with_capacity(end + APPENDED);
                bytes.extend_from_slice(&file[..end]);
                bytes
            }
        };
        Self { bytes, end }
    }

    /// The file with this guard.
    pub(super) fn ending(&mut self, guard: Guard) -> &[u8] {
        let guard = match guard {
            // with the zero that is stuffed after a byte of ones
            Guard::Ones => [0xFF, 0x00],
            Guard::Zeros => [0x00, 0x00],
        };
        self.bytes.truncate(self.end);
        self.bytes.extend(guard.repeat(REPETITIONS));
        self.bytes.extend([0xFF, EOI]);
        &self.bytes
    }
}
