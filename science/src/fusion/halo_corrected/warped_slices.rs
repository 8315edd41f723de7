//! Rectangles of the warped slices, read back from the scratch file of the first pass.

use crate::{
    fusion::{align::Aligned, lock::Spare},
    imaging::{
        Coverage, Plane, Rect, Sample,
        filter::disc::Disc,
        grey,
        simd::{self, Avx2},
    },
    types::{Control, Interrupted},
};

/// The warped slices of a stack: samples of kind `S`, `C` channels.
pub(crate) struct WarpedSlices<'a, S, const C: usize> {
    aligned: &'a Aligned,
    control: &'a dyn Control,
    spare: Spare<(Vec<S>, Vec<u8>)>,
}

impl<'a, S: Sample, const C: usize> WarpedSlices<'a, S, C> {
    pub(super) fn new(aligned: &'a Aligned, control: &'a dyn Control) -> Self {
        Self { aligned, control, spare: Spare::new() }
    }

    /// The control of the fusion.
    pub(super) fn control(&self) -> &dyn Control {
        self.control
    }

    /// Number of slices.
    pub(super) fn count(&self) -> usize {
        self.aligned.coverages.len()
    }

    /// Width and height of the canvas, px.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.aligned.index.width, self.aligned.index.height)
    }

    /// The part of the canvas that a slice covers.
    pub(super) fn coverage(&self, slice: usize) -> &Coverage {
        &self.aligned.coverages[slice]
    }

    /// Whether a slice covers all of `rect`.
    pub(super) fn covers(&self, slice: usize, rect: Rect) -> bool {
        self.coverage(slice).contains(rect)
    }

    /// Interleaved samples of `rect`, in the format of the slice.
    pub(super) fn samples(&self, slice: usize, rect: Rect) -> Result<Vec<S>, Interrupted> {
        self.read(slice, rect, <[S]>::to_vec)
    }

    /// What `of` makes of the interleaved samples of `rect`.
    pub(super) fn read<T>(&self, slice: usize, rect: Rect, of: impl FnOnce(&[S]) -> T) -> Result<T, Interrupted> {
        self.control.check()?;
        self.spare.with(Default::default, |(samples, bytes)| {
            self.aligned.scratch.read(slice, rect, samples, bytes)?;
            Ok(of(samples))
        })
    }

    /// Luma of `rect`, 0 to 255. Beyond the border of the slice its border pixels are repeated.
    pub(super) fn luma(&self, slice: usize, rect: Rect) -> Result<Plane<f32>, Interrupted> {
        let mut plane = Plane::filled(rect.width, rect.height, 0.0);
        self.read(slice, rect, |samples| grey::luma_row(samples, C, &mut plane.data))?;
        self.coverage(slice).extend(rect, &mut plane);
        Ok(plane)
    }

    /// The channels of `rect`. Beyond the border of the slice its border pixels are repeated.
    pub(super) fn patch(&self, slice: usize, rect: Rect) -> Result<Patch<C>, Interrupted> {
        let mut planes: [Plane<f32>; C] = std::array::from_fn(|_| Plane::filled(rect.width, rect.height, 0.0));
        let out = planes.each_mut().map(|plane| &mut plane.data[..]);
        self.read(slice, rect, |samples| {
            simd::run(
                Avx2::detect(),
                #[inline(always)]
                || {
                    for (channel, out) in out.into_iter().enumerate() {
                        for (out, pixel) in out.iter_mut().zip(samples.as_chunks::<C>().0) {
                            *out = pixel[channel].value();
                        }
                    }
                },
            );
        })?;
        planes.iter_mut().for_each(|plane| self.coverage(slice).extend(rect, plane));
        Ok(Patch { rect, channels: planes })
    }
}

/// The channels of a rectangle of a slice, in the scale of its samples.
pub(super) struct Patch<const C: usize> {
    /// The rectangle on the canvas.
    pub rect: Rect,
    pub channels: [Plane<f32>; C],
}

impl<const C: usize> Patch<C> {
    /// The part `rect` of the patch, in coordinates of the canvas, blurred by `disc`. Beyond the patch its border
    /// pixels are repeated.
    pub(super) fn blurred(&self, disc: &Disc, rect: Rect) -> Self {
        let inner = Rect { x: rect.x - self.rect.x, y: rect.y - self.rect.y, ..rect };
        Self { rect, channels: self.channels.each_ref().map(|channel| disc.blurred_in(channel, inner)) }
    }

    /// Index, in each channel, of the pixel (x, y) of the canvas, which the patch must contain.
    #[inline]
    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        (y - self.rect.y) * self.rect.width + x - self.rect.x
    }

    /// Row `y` of `rect` in a channel, both in coordinates of the canvas. The patch must contain `rect`.
    pub(super) fn row(&self, channel: usize, y: usize, rect: Rect) -> &[f32] {
        let start = self.index(rect.x, y);
        &self.channels[channel].data[start..start + rect.width]
    }
}
