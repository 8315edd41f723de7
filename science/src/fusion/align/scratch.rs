//! The scratch file: the warped slices between the two passes.
//!
//! A slice is stored in blocks of [`BLOCK`] x [`BLOCK`] px, row of blocks by row of blocks. A tile with its margin is
//! then a few long runs of bytes instead of one run per row of pixels.
//!
//! Rows of blocks are dealt out to several files, one after the other, because the system lets only one thread at a
//! time write to a file: with eight threads and one file, threads would often wait for each other.

use std::{fs::File, io, os::unix::fs::FileExt, path::Path};

use rayon::prelude::*;

use super::equalisation::Equalisation;
use crate::{
    imaging::{Rect, Sample, simd},
    types::{Control, Error, ErrorKind, Interrupted},
};

/// Side of a block, px. Blocks at the right and bottom border are padded to the full size.
pub(in crate::fusion) const BLOCK: usize = 32;

/// Number of files.
const FILES: usize = 16;

/// Unnamed files that hold all warped slices as interleaved samples. The system deletes them when this value is
/// dropped, and also when the process is killed.
#[derive(Debug)]
pub(in crate::fusion) struct ScratchFile {
    files: Vec<File>,
    width: usize,
    height: usize,
    channels: usize,
}

impl ScratchFile {
    /// Creates the files in `folder` for slices of `width` x `height` px with `channels` samples per pixel.
    pub(super) fn create(folder: &Path, width: usize, height: usize, channels: usize) -> Result<Self, Error> {
        let file = |_| tempfile::tempfile_in(folder).map_err(|error| failed("create", &error));
        Ok(Self { files: (0..FILES).map(file).collect::<Result<_, _>>()?, width, height, channels })
    }

    /// Multiplies the samples of each slice by the factors of its channels.
    pub(super) fn equalise<S: Sample>(
        &self,
        factors: &[Option<[f32; 3]>],
        control: &dyn Control,
    ) -> Result<(), Interrupted> {
        for (slice, equalisation) in Equalisation::of_slices(factors).into_iter().enumerate() {
            let Some(equalisation) = equalisation else { continue };
            let rows = (0..self.height).into_par_iter().step_by(BLOCK);
            rows.try_for_each_init(Default::default, |(samples, beside, bytes): &mut (Vec<S>, Vec<S>, _), y| {
                control.check()?;
                let rect = Rect { x: 0, y, width: self.width, height: BLOCK.min(self.height - y) };
                self.read(slice, rect, samples, bytes)?;
                match equalisation.beside.filter(|_| Equalisation::needs_beside(samples)) {
                    Some(slice) => self.read(slice, rect, beside, bytes)?,
                    None => {
                        beside.clear();
                        beside.resize(samples.len(), S::default());
                    }
                }
                equalisation.apply(samples, beside, self.channels);
                let rows = samples.chunks_exact((self.width * self.channels).max(1));
                Ok::<_, Interrupted>(rows.zip(y..).try_for_each(|(row, y)| self.write_row(slice, y, row, bytes))?)
            })?;
        }
        Ok(())
    }

    /// Writes all samples of slice `index`.
    pub(super) fn write<S: Sample>(&self, index: usize, samples: &[S]) -> Result<(), Error> {
        let mut blocks = Vec::new();
        let rows = samples.chunks_exact((self.width * self.channels).max(1));
        rows.enumerate().try_for_each(|(y, row)| self.write_row(index, y, row, &mut blocks))
    }

    /// Writes row `y` of slice `index`. `blocks` collects a row of blocks, and is written to the disk with its last
    /// row: the rows of a row of blocks have to come from the first to the last, with the same `blocks`.
    pub(super) fn write_row<S: Sample>(
        &self,
        index: usize,
        y: usize,
        row: &[S],
        blocks: &mut Vec<u8>,
    ) -> Result<(), Error> {
        let block = self.block_row::<S>();
        blocks.resize(self.columns() * block * BLOCK, 0);
        let line = y % BLOCK * block;
        for (part, out) in simd::bytes_of(row).chunks(block).zip(blocks.chunks_exact_mut(block * BLOCK)) {
            copy(part, &mut out[line..line + part.len()]);
        }
        if (y + 1).is_multiple_of(BLOCK) || y + 1 == self.height {
            let (file, at) = self.place::<S>(index, 0, y / BLOCK);
            file.write_all_at(blocks, at).map_err(|error| failed("write", &error))?;
        }
        Ok(())
    }

    /// Reads the pixels of `rect` of slice `index` into `samples`, row by row. `bytes` is a buffer.
    pub(in crate::fusion) fn read<S: Sample>(
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
        // bytes of the first block that lie left of the rectangle
        let cut = (rect.x - first * BLOCK) * self.channels * S::BYTES;
        let mut lines = simd::bytes_of_mut(samples).chunks_exact_mut(row * S::BYTES);
        for band in rect.y / BLOCK..(rect.y + rect.height).div_ceil(BLOCK) {
            let (file, at) = self.place::<S>(index, first, band);
            file.read_exact_at(bytes, at).map_err(|error| failed("read", &error))?;
            let rows = rect.y.max(band * BLOCK)..(rect.y + rect.height).min((band + 1) * BLOCK);
            for (y, mut rest) in rows.zip(&mut lines) {
                for (i, from) in bytes.chunks_exact(block * BLOCK).enumerate() {
                    let part = &from[y % BLOCK * block..][..block];
                    let part = if i == 0 { &part[cut..] } else { part };
                    let (to, after) = rest.split_at_mut(part.len().min(rest.len()));
                    copy(&part[..to.len()], to);
                    rest = after;
                }
            }
        }
        Ok(())
    }

    /// Blocks per row of blocks.
    fn columns(&self) -> usize {
        self.width.div_ceil(BLOCK)
    }

    /// Bytes of one row of pixels of a block.
    fn block_row<S: Sample>(&self) -> usize {
        BLOCK * self.channels * S::BYTES
    }

    /// The file of a block, and its offset there.
    fn place<S: Sample>(&self, index: usize, column: usize, band: usize) -> (&File, u64) {
        let row_of_blocks = index * self.height.div_ceil(BLOCK) + band;
        let block = row_of_blocks / FILES * self.columns() + column;
        (&self.files[row_of_blocks % FILES], (block * BLOCK * self.block_row::<S>()) as u64)
    }
}

impl Drop for ScratchFile {
    /// Closes the files in parallel: deleting a gigabyte takes a tenth of a second.
    fn drop(&mut self) {
        self.files.par_drain(..).for_each(drop);
    }
}

/// Copies a row of a block. The lengths of whole rows are constants, so that the compiler copies them without a call.
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

/// System error codes for too many open files, of the process (`EMFILE`) and of the system (`ENFILE`). No
/// [`io::ErrorKind`] names them.
const TOO_MANY_FILES: [i32; 2] = [24, 23];

fn failed(verb: &str, error: &io::Error) -> Error {
    // only the kind of the error: its text may contain a path of the server
    let kind = error.kind().to_string();
    let too_many = error.raw_os_error().is_some_and(|code| TOO_MANY_FILES.contains(&code));
    let (code, what, advice) = match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            (ErrorKind::DiskFull, &*kind, "free some space on the server's disk and run the stack again")
        }
        _ if too_many => (
            ErrorKind::ResourcesExhausted,
            "too many open files",
            "raise the server's limit of open files (ulimit -n, LimitNOFILE of systemd)",
        ),
        _ => (ErrorKind::ResourcesExhausted, &*kind, "check the server's data folder"),
    };
    Error::new(code, format!("cannot {verb} the scratch file of the fusion: {what}; {advice}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fusion::Plan, imaging::Depth};

    fn reads_back<S: Sample>(channels: usize, sample: fn(usize) -> S) {
        for (width, height) in [(1, 1), (31, 33), (64, 32), (100, 70)] {
            let scratch = ScratchFile::create(&std::env::temp_dir(), width, height, channels).unwrap();
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
    fn any_rectangle_of_any_slice_is_read_back_as_it_was_written() {
        reads_back::<u8>(3, |i| (i % 251) as u8);
        reads_back::<u8>(1, |i| (i % 251) as u8);
        reads_back::<u16>(3, |i| (i % 65_521) as u16);
        reads_back::<u16>(1, |i| (i % 65_521) as u16);
    }

    #[test]
    fn the_files_are_as_large_as_the_plan_says() {
        for (width, height, slices) in [(100, 70, 3), (64, 32, 1), (33, 700, 2)] {
            let scratch = ScratchFile::create(&std::env::temp_dir(), width, height, 3).unwrap();
            (0..slices).for_each(|slice| scratch.write(slice, &vec![7u8; width * height * 3]).unwrap());
            let bytes: u64 = scratch.files.iter().map(|file| file.metadata().unwrap().len()).sum();
            assert_eq!(bytes, Plan::aligned(width, height, slices).scratch_bytes(3, Depth::Eight));
        }
    }

    #[test]
    fn the_advice_is_about_what_is_exhausted() {
        for (number, kind, advice) in [
            (24, ErrorKind::ResourcesExhausted, "limit of open files"),
            (23, ErrorKind::ResourcesExhausted, "limit of open files"),
            (28, ErrorKind::DiskFull, "free some space"),
            (5, ErrorKind::ResourcesExhausted, "data folder"),
        ] {
            let error = failed("create", &io::Error::from_raw_os_error(number));
            assert!(error.kind == kind && error.detail.contains(advice), "{number}: {error:?}");
        }
    }

    #[test]
    fn a_disk_error_is_reported_as_a_server_error_without_a_path() {
        let folder = Path::new("/no/such/folder/of/the/server");
        let error = ScratchFile::create(folder, 1, 1, 3).expect_err("the folder does not exist");
        assert!(matches!(error.kind, ErrorKind::DiskFull | ErrorKind::ResourcesExhausted), "{error:?}");
        assert!(!error.detail.contains("/no/such"), "{}", error.detail);
    }
}
