//! The sample format of a stack, and its slices converted to it.

use std::{iter, sync::Mutex};

use rayon::prelude::*;

use super::{in_flight::slices_in_flight, lock::locked, plan::Plan};
use crate::{
    imaging::{Depth, Raster, Sample, Samples, Slices},
    types::{Error, ErrorKind},
};

/// Bit depth and channels of a stack: those of its first slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SampleFormat {
    pub depth: Depth,
    /// 1 or 3.
    pub channels: usize,
}

impl SampleFormat {
    fn of(raster: &Raster) -> Result<Self, Error> {
        match raster.channels {
            1 | 3 => Ok(Self { depth: raster.depth(), channels: raster.channels }),
            other => Err(Error::new(
                ErrorKind::InvalidImage,
                format!("the slice has {other} channels; save slices as grey or RGB images without alpha"),
            )),
        }
    }
}

/// The slices of a stack, converted to the format of the first one while they are loaded.
///
/// The format is known only once slice 0 is decoded. The slices after it are decoded at the same time by other threads,
/// and all of these rasters are kept until they are loaded, so that no slice is decoded twice.
pub(super) struct FormattedSlices<'a> {
    slices: &'a dyn Slices,
    width: usize,
    height: usize,
    format: SampleFormat,
    /// The first slices, decoded; none once it is loaded.
    first: Vec<Mutex<Option<Result<Raster, Error>>>>,
    /// Memory of decoded slices that are no longer needed, for the next ones.
    spare: Mutex<Vec<Vec<u8>>>,
}

impl<'a> FormattedSlices<'a> {
    /// Decodes the first slices of the stack of `plan`, as many as will be in flight at a time.
    ///
    /// # Errors
    /// An error that names the slice when slice 0 cannot be decoded or is neither grey nor RGB. Errors of other slices
    /// are those of [`FormattedSlices::load`].
    pub(super) fn open(slices: &'a dyn Slices, plan: &Plan) -> Result<Self, Error> {
        let ahead = slices_in_flight(rayon::current_num_threads(), plan.slices.len());
        let decode = |slice: usize| slices.load(slice);
        let (zeroth, others): (_, Vec<_>) =
            rayon::join(|| decode(0), || (1..ahead).into_par_iter().with_max_len(1).map(decode).collect());
        let zeroth = zeroth?;
        let format = SampleFormat::of(&zeroth).map_err(|error| error.in_file(slices.name(0), Some(0)))?;
        let first = iter::once(Ok(zeroth)).chain(others).map(|raster| Mutex::new(Some(raster))).collect();
        let (width, height) = (plan.width, plan.height);
        Ok(Self { slices, width, height, format, first, spare: Mutex::default() })
    }

    /// Takes the samples of a slice back, so that the next slice can be decoded into their memory.
    pub(super) fn recycle<S: Sample>(&self, samples: Vec<S>) {
        if let Samples::Eight(samples) = S::wrap(samples) {
            locked(&self.spare).push(samples);
        }
    }

    /// Frees the memory of recycled slices.
    pub(super) fn free_memory(&self) {
        locked(&self.spare).clear();
    }

    pub(super) fn format(&self) -> SampleFormat {
        self.format
    }

    /// Names of all slices, as the user knows them.
    pub(super) fn names(&self) -> Vec<String> {
        (0..self.slices.count()).map(|slice| self.slices.name(slice).to_owned()).collect()
    }

    /// Interleaved samples of slice `slice`; `S` and `C` are those of [`FormattedSlices::format`].
    ///
    /// | slice | result |
    /// |---|---|
    /// | 8 bits in a stack of 16 | samples times 257 |
    /// | grey in a stack in colour | the grey sample in every channel |
    /// | 16 bits in a stack of 8, colour in a grey stack | refused: information would be lost |
    ///
    /// # Errors
    /// An error that names the slice when it cannot be decoded, has another size, or would lose information.
    pub(super) fn load<S: Sample, const C: usize>(&self, slice: usize) -> Result<Vec<S>, Error> {
        let raster = match self.first.get(slice).and_then(|first| locked(first).take()) {
            Some(raster) => raster?,
            None => {
                let buffer = locked(&self.spare).pop().unwrap_or_default();
                self.slices.load_into(slice, buffer)?
            }
        };
        let name = self.slices.name(slice);
        let located = |error: Error| error.in_file(name, Some(slice as u32));
        if (raster.width, raster.height) != (self.width, self.height) {
            let detail = format!(
                "'{name}' (slice {slice}) is {} x {} px and the profile is for {} x {} px; use the image size of the \
                 calibration",
                raster.width, raster.height, self.width, self.height
            );
            return Err(located(Error::new(ErrorKind::SizeMismatch, detail)));
        }
        let format = SampleFormat::of(&raster).map_err(located)?;
        let refused = |what: &str| {
            let detail = format!("'{name}' (slice {slice}) {what}; save all slices in one format");
            Err(located(Error::new(ErrorKind::InvalidImage, detail)))
        };
        if format.channels > C {
            return refused("is in colour and the first slice is grey");
        }
        let samples = match raster.samples {
            samples if format.depth == S::DEPTH => samples,
            Samples::Eight(samples) => Samples::Sixteen(samples.into_iter().map(|v| u16::from(v) * 257).collect()),
            Samples::Sixteen(_) => return refused("has 16 bits per sample and the first slice has 8"),
        };
        if format.channels == C {
            return S::from_samples(samples)
                .ok_or_else(|| Error::new(ErrorKind::Internal, "a slice has an unexpected bit depth"));
        }
        let grey = S::of(&samples).unwrap_or_default();
        Ok(grey.iter().flat_map(|&sample| [sample; C]).collect())
    }
}
