//! Which pixels of a block count, alone and with their neighbourhoods.

use crate::imaging::Plane;

/// The pixels of a block that count: weight 1, others 0.
#[derive(Debug, Clone)]
pub(super) struct PixelWeights {
    pub(super) weights: Plane<f32>,
    /// Whether all pixels count.
    all: bool,
}

impl PixelWeights {
    pub(super) fn of(shape: &Plane<f32>, counts: impl Fn(usize) -> bool) -> Self {
        let data: Vec<f32> = (0..shape.data.len()).map(|i| if counts(i) { 1.0 } else { 0.0 }).collect();
        let all = !data.contains(&0.0);
        Self { weights: Plane { width: shape.width, height: shape.height, data }, all }
    }

    /// Per upper left corner of a `side` x `side` neighbourhood: 1 if all its pixels count, else 0; `side - 1` smaller.
    pub(super) fn whole_neighbourhoods(&self, side: usize) -> Plane<f32> {
        let (width, height) = (self.weights.width, self.weights.height);
        if width < side || height < side {
            return Plane::default();
        }
        if self.all {
            return Plane::filled(width + 1 - side, height + 1 - side, 1.0);
        }
        let bytes = self.weights.map(|weight| if weight > 0.0 { 255u8 } else { 0 });
        whole_neighbourhoods(&bytes, side).map(|whole| if whole != 0 { 1.0 } else { 0.0 })
    }
}

pub(in crate::quality) fn same_shape<A, B>(a: &Plane<A>, b: &Plane<B>) -> bool {
    a.width == b.width && a.height == b.height && a.data.len() == b.data.len()
}

/// Per upper left corner of a `side` x `side` neighbourhood: 255 if all its pixels are non-zero, else 0. The result is
/// `side - 1` smaller in width and height, and empty if the plane is too small.
pub(in crate::quality) fn whole_neighbourhoods(counts: &Plane<u8>, side: usize) -> Plane<u8> {
    if counts.width < side || counts.height < side {
        return Plane::default();
    }
    let (width, height) = (counts.width + 1 - side, counts.height + 1 - side);
    let mut across = Plane::filled(width, counts.height, 255u8);
    for y in 0..counts.height {
        let row = counts.row(y);
        for k in 0..side {
            across.row_mut(y).iter_mut().zip(&row[k..]).for_each(|(all, &c)| *all &= c);
        }
    }
    let mut whole = Plane::filled(width, height, 255u8);
    for y in 0..height {
        for k in 0..side {
            whole.row_mut(y).iter_mut().zip(across.row(y + k)).for_each(|(all, &c)| *all &= c);
        }
    }
    whole
}
