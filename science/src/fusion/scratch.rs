//! Warped slices between the two passes, in a file that nobody else sees.
//!
//! A slice lies there in squares of [`BLOCK`] px, a row of squares after the other, so that a tile and its surroundings
//! are a few long runs of bytes, and not a run per row of pixels.

use std::{fs::File, io, os::unix::fs::FileExt, path::Path};

use rayon::prelude::*;

use crate::{
    imaging::{Rect, Sample, simd},
    types::{Error, ErrorKind},
};

/// Side of the squares, px. Those at the right border are as large as all others.
pub(super) const BLOCK: usize = 32;

/// An unnamed file with room for all warped slices, one after the other, interleaved samples. It is gone when this is
/// dropped, and also when the process dies.
#[derive(Debug)]
pub(super) struct Scratch {
    file: File,
    width: usize,
    height: usize,
    channels: usize,
}

impl Scratch {
    /// A file for slices of `width` x `height` px with `channels` samples in `folder`.
    pub(super) fn create(folder: &Path, width: usize, height: usize, channels: usize) -> Result<Self, Error> {
        let file = tempfile::tempfile_in(folder).map_err(|error| fault("make", &error))?;
        Ok(Self { file, width, height, channels })
    }

    /// Writes slice `index`, whole.
    pub(super) fn write<S: Sample>(&self, index: usize, samples: &[S]) -> Result<(), Error> {
        let (row, block) = (self.width * self.channels * S::BYTES, self.block_row::<S>());
        let samples = simd::bytes_of(samples);
        samples.par_chunks((row * BLOCK).max(1)).enumerate().try_for_each_init(Vec::new, |bytes, (band, rows)| {
            bytes.resize(self.columns() * block * BLOCK, 0);
            for (y, line) in rows.chunks_exact(row).enumerate() {
                for (part, square) in line.chunks(block).zip(bytes.chunks_exact_mut(block * BLOCK)) {
                    copy(part, &mut square[y * block..y * block + part.len()]);
                }
            }
            self.file.write_all_at(bytes, self.start::<S>(index, 0, band)).map_err(|error| fault("write", &error))
        })
    }

    /// Reads the pixels of `rect` of slice `index` into `samples`, row by row. `bytes` is a buffer.
    pub(super) fn read<S: Sample>(
        &self,
        index: usize,
        rect: Rect,
        samples: &mut Vec<S>,
        bytes: &mut Vec<u8>,
    ) -> Result<(), Error> {
        let (row, block) = (rect.width * self.channels, self.block_row::<S>());
        samples.resize(row * rect.height, S::default());
        if samples.is_empty() {
            return Ok(());
        }
        let (first, end) = (rect.x / BLOCK, (rect.x + rect.width).div_ceil(BLOCK));
        bytes.resize((end - first) * block * BLOCK, 0);
        // of the first square only what lies in the rectangle
        let cut = (rect.x - first * BLOCK) * self.channels * S::BYTES;
        let mut lines = simd::bytes_of_mut(samples).chunks_exact_mut(row * S::BYTES);
        for band in rect.y / BLOCK..(rect.y + rect.height).div_ceil(BLOCK) {
            let at = self.start::<S>(index, first, band);
            self.file.read_exact_at(bytes, at).map_err(|error| fault("read", &error))?;
            let rows = rect.y.max(band * BLOCK)..(rect.y + rect.height).min((band + 1) * BLOCK);
            for (y, mut rest) in rows.zip(&mut lines) {
                for (i, square) in bytes.chunks_exact(block * BLOCK).enumerate() {
                    let part = &square[y % BLOCK * block..][..block];
                    let part = if i == 0 { &part[cut..] } else { part };
                    let (to, after) = rest.split_at_mut(part.len().min(rest.len()));
                    copy(&part[..to.len()], to);
                    rest = after;
                }
            }
        }
        Ok(())
    }

    /// Squares beside each other.
    fn columns(&self) -> usize {
        self.width.div_ceil(BLOCK)
    }

    /// Bytes of a row of a square.
    fn block_row<S: Sample>(&self) -> usize {
        BLOCK * self.channels * S::BYTES
    }

    /// Where a square lies.
    fn start<S: Sample>(&self, index: usize, column: usize, band: usize) -> u64 {
        let square = (index * self.height.div_ceil(BLOCK) + band) * self.columns() + column;
        (square * BLOCK * self.block_row::<S>()) as u64
    }
}

/// Copies a row of a square; whole ones without asking the library how.
#[inline(always)]
fn copy(from: &[u8], to: &mut [u8]) {
    macro_rules! of_length {
        ($($length:literal)*) => {
            match from.len() {
                $($length => {
                    if let (Some(from), Some(to)) = (from.first_chunk::<$length>(), to.first_chunk_mut::<$length>()) {
                        *to = *from;
                    }
                })*
                _ => to.copy_from_slice(from),
            }
        };
    }
    of_length!(32 64 96 192);
}

fn fault(verb: &str, error: &io::Error) -> Error {
    let full = matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded);
    let (code, advice) = match full {
        true => (ErrorKind::DiskFull, "make room on the server's disk and run the stack again"),
        false => (ErrorKind::ResourcesExhausted, "look at the server's data folder"),
    };
    // the kind alone: the text of the error may hold a path of the server
    Error::new(code, format!("cannot {verb} the scratch file of the fusion ({}); {advice}", error.kind()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reads_back<S: Sample>(channels: usize, sample: fn(usize) -> S) {
        for (width, height) in [(1, 1), (31, 33), (64, 32), (100, 70)] {
            let scratch = Scratch::create(&std::env::temp_dir(), width, height, channels).unwrap();
            let slices = [0, 1, 2].map(|slice| {
                let samples: Vec<S> = (0..width * height * channels).map(|i| sample(i * 31 + slice * 7)).collect();
                scratch.write(slice, &samples).unwrap();
                samples
            });
            let part = Rect { x: width / 3, y: height / 4, width: width - width / 3 - width / 8, height: height / 2 };
            let (mut read, mut bytes) = (Vec::<S>::new(), Vec::new());
            for (slice, samples) in slices.iter().enumerate() {
                for rect in [Rect::whole(width, height), part] {
                    scratch.read(slice, rect, &mut read, &mut bytes).unwrap();
                    let rows = (rect.y..rect.y + rect.height).flat_map(|y| {
                        let start = (y * width + rect.x) * channels;
                        &samples[start..start + rect.width * channels]
                    });
                    assert!(read.iter().eq(rows), "{width} x {height}, {rect:?}");
                }
            }
        }
    }

    #[test]
    fn any_part_of_any_slice_reads_back_as_it_was_written() {
        reads_back::<u8>(3, |i| (i % 251) as u8);
        reads_back::<u8>(1, |i| (i % 251) as u8);
        reads_back::<u16>(3, |i| (i % 65_521) as u16);
        reads_back::<u16>(1, |i| (i % 65_521) as u16);
    }

    #[test]
    fn an_error_of_the_disk_is_one_of_the_machine_and_shows_no_path() {
        let folder = Path::new("/no/such/folder/of/the/server");
        let fault = Scratch::create(folder, 1, 1, 3).expect_err("there is no such folder");
        assert!(matches!(fault.kind, ErrorKind::DiskFull | ErrorKind::ResourcesExhausted), "{fault:?}");
        assert!(!fault.detail.contains("/no/such"), "{}", fault.detail);
    }
}
