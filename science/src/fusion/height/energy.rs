//! The focus energy of a rectangle of a warped slice, which is read back from the scratch file.

use crate::{
    fusion::align::Aligned,
    imaging::{
        Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
        grey,
    },
    types::Error,
};

/// Buffers for samples that are read back.
pub(super) type Buffers<S> = (Vec<S>, Vec<u8>);

/// The focus energy of `rect` in a warped slice: `emit(row, energies)` receives the rows from 0 on.
pub(super) fn energy<S: Sample, const C: usize>(
    aligned: &Aligned,
    slice: usize,
    rect: Rect,
    measure: &FocusEnergy,
    rows: &mut Rows,
    (samples, bytes): &mut Buffers<S>,
    mut emit: impl FnMut(usize, &[f32]),
) -> Result<(), Error> {
    let window = rect.grown(measure.reach(), aligned.index.width, aligned.index.height);
    aligned.scratch.read(slice, window, samples, bytes)?;
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let luma = |y: usize, out: &mut [f32]| grey::luma_row(&samples[y * window.width * C..][..window.width * C], C, out);
    measure.rows((window.width, window.height), top..top + rect.height, rows, luma, |y, energies| {
        emit(y - top, &energies[left..left + rect.width]);
    });
    Ok(())
}
