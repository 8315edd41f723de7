//! Removes alpha channels.

use super::ImageFault;

/// The first `kept` of `stored` channels. The others are alpha, which must be `opaque` everywhere.
///
/// # Errors
/// [`ImageFault::Unsupported`] for a picture that is transparent somewhere: a transparent pixel does not show the
/// object, and its samples may be multiplied by alpha (TIFF, `ExtraSamples` 1).
pub(super) fn without_alpha<T: Copy + PartialEq>(
    mut samples: Vec<T>,
    stored: usize,
    kept: usize,
    opaque: T,
) -> Result<Vec<T>, ImageFault> {
    if stored == kept {
        return Ok(samples);
    }
    let pixels = samples.len() / stored;
    let mut transparent = 0;
    for pixel in 0..pixels {
        let at = pixel * stored;
        transparent += usize::from(samples[at + kept..at + stored].iter().any(|&alpha| alpha != opaque));
        samples.copy_within(at..at + kept, pixel * kept);
    }
    refuse(transparent, pixels)?;
    samples.truncate(pixels * kept);
    Ok(samples)
}

/// Refuses pictures with transparent pixels.
pub(super) fn refuse(transparent: usize, pixels: usize) -> Result<(), ImageFault> {
    if transparent == 0 {
        return Ok(());
    }
    Err(ImageFault::Unsupported {
        what: format!("{transparent} of its {pixels} pixels are transparent, wholly or partly (alpha channel)"),
        advice: "slices have to be opaque: flatten them, or save them without alpha",
    })
}
