//! Small copies of slices, kept in the scratch folder while the slices stream by, so that pictures for people need no
//! second decoding.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use pinstack_science::{
    imaging::{Raster, Samples, Slices},
    types::{Error, ErrorKind},
};

use crate::store::failpoint::step;

/// Long side of a copy at most, px.
const SIDE: usize = 1600;

/// Slices that leave a small 8-bit copy behind when they are loaded.
pub(super) struct Copying<'a> {
    slices: &'a dyn Slices,
    folder: &'a Path,
}

impl<'a> Copying<'a> {
    /// `folder` is the job's own and exists.
    pub(super) fn new(slices: &'a dyn Slices, folder: &'a Path) -> Self {
        Self { slices, folder }
    }

    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("copy-{index}"))
    }

    /// The small copy of a slice; made now when the slice was never loaded.
    pub(super) fn copy(&self, index: usize) -> Result<Raster, Error> {
        if !self.path(index).exists() {
            self.load(index)?;
        }
        let read = fs::read(self.path(index)).map_err(|error| failed(&error))?;
        unpacked(&read).ok_or_else(|| failed(&"it is not as long as it says"))
    }
}

impl Slices for Copying<'_> {
    fn count(&self) -> usize {
        self.slices.count()
    }

    fn name(&self, index: usize) -> &str {
        self.slices.name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        let slice = self.slices.load(index)?;
        step("copy.write")
            .and_then(|()| fs::write(self.path(index), packed(&smaller(&slice))))
            .map_err(|e| unwritten(&e))?;
        Ok(slice)
    }
}

fn unwritten(error: &io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Error::new(
            ErrorKind::DiskFull,
            "the disk of the service is full, so the job could not go on; make room and send the target again",
        ),
        _ => {
            tracing::error!(%error, "cannot write a copy of a slice");
            let detail =
                "the service could not write into its scratch folder; its log has the details under the job's id";
            Error::new(ErrorKind::ResourcesExhausted, detail)
        }
    }
}

fn failed(error: &dyn std::fmt::Display) -> Error {
    tracing::error!(%error, "cannot keep a copy of a slice in the scratch folder");
    let detail = "the service could not use its scratch folder; its log has the details under the job's id";
    Error::new(ErrorKind::Internal, detail)
}

/// Four samples of each cell of the slice, averaged: fast, and good enough for the eye.
fn smaller(slice: &Raster) -> Raster {
    let bin = slice.width.max(slice.height).div_ceil(SIDE).max(1);
    let (width, height, channels) = (slice.width / bin, slice.height / bin, slice.channels.min(3));
    let (low, high) = (bin / 4, bin - 1 - bin / 4);
    let value = |x: usize, y: usize, c: usize| -> u32 {
        let at = (y * slice.width + x) * slice.channels + c;
        match &slice.samples {
            Samples::Eight(s) => u32::from(s[at]),
            Samples::Sixteen(s) => u32::from(s[at] >> 8),
        }
    };
    let mut samples = Vec::with_capacity(width * height * channels);
    for y in 0..height {
        for x in 0..width {
            let corner = [x * bin, y * bin];
            for c in 0..channels {
                let sum: u32 = [(low, low), (high, low), (low, high), (high, high)]
                    .iter()
                    .map(|(dx, dy)| value(corner[0] + dx, corner[1] + dy, c))
                    .sum();
                samples.push(((sum + 2) / 4) as u8);
            }
        }
    }
    Raster::eight(width, height, channels, samples)
}

fn packed(copy: &Raster) -> Vec<u8> {
    let mut bytes: Vec<u8> =
        [copy.width, copy.height, copy.channels].iter().flat_map(|n| (*n as u32).to_le_bytes()).collect();
    if let Samples::Eight(samples) = &copy.samples {
        bytes.extend_from_slice(samples);
    }
    bytes
}

fn unpacked(bytes: &[u8]) -> Option<Raster> {
    let number = |k: usize| Some(u32::from_le_bytes(bytes.get(4 * k..4 * k + 4)?.try_into().ok()?) as usize);
    let (width, height, channels) = (number(0)?, number(1)?, number(2)?);
    let samples = bytes.get(12..)?;
    (samples.len() == width * height * channels).then(|| Raster::eight(width, height, channels, samples.to_vec()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_is_small_looks_the_same_and_is_kept_while_the_slice_goes_by() {
        let folder = tempfile::tempdir().expect("a folder");
        let slice = Raster::sixteen(3300, 20, 1, (0..66_000_u32).map(|k| ((k % 3300) * 16) as u16).collect());
        let slices = [slice];
        let source = &slices[..];
        let copying = Copying::new(&source, folder.path());
        assert_eq!(copying.load(0).expect("a slice"), slices[0]);
        let copy = copying.copy(0).expect("a copy");
        assert_eq!((copy.width, copy.height, copy.channels), (1100, 6, 1));
        let Samples::Eight(samples) = &copy.samples else { panic!("copies have 8 bits") };
        for x in [10, 500, 1090] {
            let middle = ((3 * x + 1) * 16) >> 8;
            assert!((i64::from(samples[x]) - middle as i64).abs() <= 1, "{} for {middle}", samples[x]);
        }
        fs::write(folder.path().join("copy-0"), b"torn").expect("written");
        assert_eq!(copying.copy(0).expect_err("torn").kind, ErrorKind::Internal);
    }
}
