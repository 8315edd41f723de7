//! Thumbnails of slices, written to the scratch folder while the slices are loaded. The overlays of a calibration are
//! drawn on them, so that no slice has to be decoded twice.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use pinstack_science::{
    imaging::{Raster, Samples, Slices, thumbnail},
    types::{Error, ErrorKind},
};

use crate::store::{failpoint::step, is_full};

/// Longest side of a thumbnail, px.
const MAX_SIDE: usize = 1600;

/// Slices that write an 8-bit thumbnail each time one is loaded.
pub(super) struct ThumbnailingSlices<'a> {
    slices: &'a dyn Slices,
    folder: &'a Path,
}

impl<'a> ThumbnailingSlices<'a> {
    /// `folder` exists and belongs to the job.
    pub(super) fn new(slices: &'a dyn Slices, folder: &'a Path) -> Self {
        Self { slices, folder }
    }

    fn path(&self, index: usize) -> PathBuf {
        self.folder.join(format!("thumbnail-{index}"))
    }

    /// The thumbnail of a slice. Loads the slice if that has not happened yet.
    pub(super) fn thumbnail(&self, index: usize) -> Result<Raster, Error> {
        if !self.path(index).exists() {
            self.load(index)?;
        }
        let read = fs::read(self.path(index)).map_err(unreadable)?;
        unpacked(&read).ok_or_else(|| unreadable(io::Error::new(io::ErrorKind::InvalidData, "truncated thumbnail")))
    }
}

impl Slices for ThumbnailingSlices<'_> {
    fn count(&self) -> usize {
        self.slices.count()
    }

    fn name(&self, index: usize) -> &str {
        self.slices.name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        let slice = self.slices.load(index)?;
        step("copy.write")
            .and_then(|()| fs::write(self.path(index), packed(&thumbnail::sampled(&slice, MAX_SIDE))))
            .map_err(unwritten)?;
        Ok(slice)
    }
}

fn unwritten(error: io::Error) -> Error {
    let (kind, detail) = if is_full(&error) {
        (
            ErrorKind::DiskFull,
            "the service has no disk space left to finish the job; free some and send the target again",
        )
    } else {
        tracing::error!(%error, "cannot write the thumbnail of a slice");
        let detail = "the service could not write to its scratch folder; its log has the details under the job's id";
        (ErrorKind::ResourcesExhausted, detail)
    };
    Error::new(kind, detail).caused_by(error)
}

fn unreadable(error: io::Error) -> Error {
    tracing::error!(%error, "cannot read the thumbnail of a slice from the scratch folder");
    let detail = "the service could not read its scratch folder; its log has the details under the job's id";
    Error::new(ErrorKind::Internal, detail).caused_by(error)
}

/// Width, height and channels as little-endian `u32`, then the samples.
fn packed(thumbnail: &Raster) -> Vec<u8> {
    let mut bytes: Vec<u8> = [thumbnail.width, thumbnail.height, thumbnail.channels]
        .iter()
        .flat_map(|n| (*n as u32).to_le_bytes())
        .collect();
    if let Samples::Eight(samples) = &thumbnail.samples {
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
    fn a_thumbnail_is_kept_when_a_slice_is_loaded() {
        let folder = tempfile::tempdir().expect("a folder");
        let slices = [Raster::sixteen(3300, 20, 1, (0..66_000_u32).map(|k| ((k % 3300) * 16) as u16).collect())];
        let source = &slices[..];
        let thumbnailing = ThumbnailingSlices::new(&source, folder.path());
        assert_eq!(thumbnailing.load(0).expect("a slice"), slices[0]);
        let small = thumbnailing.thumbnail(0).expect("a thumbnail");
        assert_eq!(small, thumbnail::sampled(&slices[0], MAX_SIDE));
        fs::write(folder.path().join("thumbnail-0"), b"torn").expect("written");
        assert_eq!(thumbnailing.thumbnail(0).expect_err("torn").kind, ErrorKind::Internal);
    }
}
