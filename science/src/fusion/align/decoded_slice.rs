//! A decoded slice of the first pass, which is warped, measured and stored band by band.

use std::sync::OnceLock;

use super::{
    focus_measure::{FocusMeasure, RowBuffers},
    scratch::ScratchFile,
    sharpest::Sharpest,
};
use crate::{
    fusion::plan::Plan,
    imaging::{Coverage, Sample, grey, warp::Warp},
    quality::slice::{Cells, Fingerprint, RowMeasurements, SliceMeter},
    types::{Error, Interrupted},
};

/// Rows of a band: a multiple of the side of a scratch block and of a cell. Rows beside a band are warped twice,
/// because the focus measure reaches beyond it; the larger the bands, the fewer these are.
const ROWS: usize = 256;

/// A decoded slice.
pub(super) struct DecodedSlice<S> {
    pub index: usize,
    pub samples: Vec<S>,
    pub warp: Warp,
    /// The pixels where the slice covers the whole window of the focus measure.
    supported: Coverage,
    /// Only with a meter.
    pub fingerprint: Option<Fingerprint>,
    /// Per band, once it is processed: the cells of the coarse focus, and what the meter takes from its rows.
    pub found: Vec<OnceLock<(Vec<f32>, RowMeasurements)>>,
}

/// What bands are processed by, and where they go.
pub(super) struct BandContext<'a> {
    pub plan: &'a Plan,
    pub meter: Option<&'a SliceMeter<'a>>,
    /// The cells in which the brightness of the slices is measured.
    pub light: Cells,
    pub scratch: ScratchFile,
    pub sharpest: Sharpest<'a>,
    pub focus: FocusMeasure,
}

/// Buffers of a thread.
pub(super) struct Buffers<S> {
    row: Vec<S>,
    blocks: Vec<u8>,
    focus: RowBuffers,
}

impl<S> Default for Buffers<S> {
    fn default() -> Self {
        Self { row: Vec::new(), blocks: Vec::new(), focus: RowBuffers::default() }
    }
}

impl<S: Sample> DecodedSlice<S> {
    /// The slice `index`; the window of the focus measure has a radius of `reach` px.
    pub(super) fn new(
        index: usize,
        samples: Vec<S>,
        warp: Warp,
        reach: usize,
        fingerprint: Option<Fingerprint>,
    ) -> Self {
        let supported = warp.coverage().eroded(reach);
        let bands = warp.coverage().height().div_ceil(ROWS).max(1);
        Self { index, samples, warp, supported, fingerprint, found: (0..bands).map(|_| OnceLock::new()).collect() }
    }

    /// Number of bands.
    pub(super) fn bands(&self) -> usize {
        self.found.len()
    }

    /// Whether all bands are processed.
    pub(super) fn is_complete(&self) -> bool {
        self.found.iter().all(|found| found.get().is_some())
    }

    /// Processes the band `band`: writes its rows to the scratch file, and updates the running argmax.
    pub(super) fn process<const C: usize>(
        &self,
        context: &BandContext<'_>,
        band: usize,
        buffers: &mut Buffers<S>,
    ) -> Result<(), Interrupted> {
        let BandContext { plan, meter, light, scratch, sharpest, focus } = context;
        let (slice, covered) = (self.index, self.warp.coverage());
        let rows = band * ROWS..((band + 1) * ROWS).min(plan.height);
        let warped = self.warp.rows::<S, C>(&self.samples);
        let Buffers { row, blocks, focus: of_focus } = buffers;
        row.resize(plan.width * C, S::default());

        let (mut of_samples, mut of_saliency) = (RowMeasurements::default(), RowMeasurements::default());
        let mut stored: Result<(), Error> = Ok(());
        let luma_of = |y: usize, out: &mut [f32]| {
            warped.row(y, row);
            grey::luma_row(row, C, out);
            if rows.contains(&y) && stored.is_ok() {
                stored = scratch.write_row(slice, y, row, blocks);
                of_samples.take_samples(*light, y, row, C, plan.slices[slice].gain);
            }
        };
        let mut cells = vec![0.0; focus.cells_in_rows(rows.len())];
        let size = (plan.width, plan.height);
        focus.rows(size, rows.clone(), of_focus, meter.is_some(), luma_of, |y, values, grey_levels| {
            sharpest.update(y, slice, values, covered, &self.supported);
            let columns = self.supported.span(y);
            if let Some(meter) = meter {
                of_saliency.take_saliency(meter, y, grey_levels, &columns);
            }
            focus.add_to_cells(&mut cells, y - rows.start, values, columns);
        });
        stored?;
        let measured = RowMeasurements::join(vec![of_samples, of_saliency]);
        // a band is processed once, so its place is empty
        let _ = self.found[band].set((cells, measured));
        Ok(())
    }
}
