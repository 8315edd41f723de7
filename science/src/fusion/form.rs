//! Depth and channels of a stack, and slices brought to them.

use crate::{
    imaging::{Depth, Raster, Sample, Samples},
    types::{Error, ErrorKind},
};

/// Bits and channels that all slices of a stack are brought to: those of its first slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Form {
    pub depth: Depth,
    /// 1 or 3.
    pub channels: usize,
}

impl Form {
    pub(super) fn of(raster: &Raster) -> Result<Self, Error> {
        match raster.channels {
            1 | 3 => Ok(Self { depth: raster.depth(), channels: raster.channels }),
            other => Err(Error::new(
                ErrorKind::InvalidImage,
                format!("a slice has {other} channels; slices are grey or RGB, without alpha"),
            )),
        }
    }
}

/// The samples of slice `index`, called `name`, in the form of the stack: `S` and `C` channels.
///
/// # Errors
/// A fault that names the slice when it would lose something: colour in a grey stack, or bits.
pub(super) fn samples_in_form<S: Sample, const C: usize>(
    raster: Raster,
    name: &str,
    index: usize,
) -> Result<Vec<S>, Error> {
    let form = Form::of(&raster).map_err(|fault| fault.in_file(name, Some(index as u32)))?;
    let refuse = |detail: String| Err(Error::new(ErrorKind::InvalidImage, detail).in_file(name, Some(index as u32)));
    if form.channels > C {
        return refuse(format!(
            "'{name}' (slice {index}) is in colour, the first slice is grey; save all slices alike"
        ));
    }
    let samples = match raster.samples {
        samples if form.depth == S::DEPTH => samples,
        Samples::Eight(samples) => Samples::Sixteen(samples.into_iter().map(|v| u16::from(v) * 257).collect()),
        Samples::Sixteen(_) => {
            return refuse(format!(
                "'{name}' (slice {index}) has 16 bits per sample, the first slice has 8; save all slices alike"
            ));
        }
    };
    if form.channels == C {
        return owned::<S>(samples).ok_or_else(|| Error::new(ErrorKind::Internal, "slice of an unexpected depth"));
    }
    let grey = S::of(&samples).unwrap_or_default();
    Ok(grey.iter().flat_map(|&sample| [sample; C]).collect())
}

/// The samples without a copy, when they are of kind `S`.
fn owned<S: Sample>(samples: Samples) -> Option<Vec<S>> {
    let any: Box<dyn std::any::Any> = match samples {
        Samples::Eight(samples) => Box::new(samples),
        Samples::Sixteen(samples) => Box::new(samples),
    };
    any.downcast().ok().map(|samples| *samples)
}
