//! The option `input_bits`: 16-bit files that hold 10, 12 or 14-bit data are scaled to full scale on request. Without
//! the option, such files cause a warning.

use std::sync::atomic::{AtomicU32, Ordering};

use crate::contract::input::InputBits;
use pinstack_science::{
    imaging::{Raster, Samples, Slices},
    types::{Error, ErrorKind, Warning, WarningCode},
};

/// Full scale of 16 bits.
const FULL_SCALE: u32 = 65_535;
/// Bit depths of camera sensors besides 8 and 16.
const SENSOR_BITS: [u32; 3] = [10, 12, 14];

/// The slices of one light, scaled to full scale. Records the brightest sample.
pub(super) struct FullScaleSlices<'a> {
    slices: &'a dyn Slices,
    bits: InputBits,
    /// Brightest 16-bit sample as stored in the files, 0 until one was loaded.
    brightest: AtomicU32,
}

impl<'a> FullScaleSlices<'a> {
    /// `bits` is the number of bits that 16-bit files use. Other files are not changed.
    pub(super) fn of(slices: &'a dyn Slices, bits: InputBits) -> Self {
        Self { slices, bits, brightest: AtomicU32::new(0) }
    }

    /// Scales the samples of slice `index` by `65535 / (2^bits - 1)`, rounded to nearest.
    fn scale(&self, samples: &mut [u16], brightest: u32, index: usize) -> Result<(), Error> {
        let Some(bits) = self.bits.bits().filter(|&bits| bits < 16) else { return Ok(()) };
        let maximum = (1u32 << bits) - 1;
        if brightest > maximum {
            let name = self.name(index);
            let detail = format!(
                "{name} has samples up to {brightest}, but input_bits={bits} allows {maximum} at most; send the stack with \
                 the correct number of bits, or omit input_bits"
            );
            return Err(Error::new(ErrorKind::InvalidImage, detail).in_file(name, u32::try_from(index).ok()));
        }
        // the quotient is at most FULL_SCALE
        samples
            .iter_mut()
            .for_each(|sample| *sample = ((u32::from(*sample) * FULL_SCALE + maximum / 2) / maximum) as u16);
        Ok(())
    }
}

impl Slices for FullScaleSlices<'_> {
    fn count(&self) -> usize {
        self.slices.count()
    }

    fn name(&self, index: usize) -> &str {
        self.slices.name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        self.load_into(index, Vec::new())
    }

    fn load_into(&self, index: usize, buffer: Vec<u8>) -> Result<Raster, Error> {
        let mut raster = self.slices.load_into(index, buffer)?;
        if let Samples::Sixteen(samples) = &mut raster.samples {
            let brightest = u32::from(samples.iter().copied().max().unwrap_or(0));
            self.brightest.fetch_max(brightest, Ordering::Relaxed);
            self.scale(samples, brightest, index)?;
        }
        Ok(raster)
    }
}

/// A warning when the brightest 16-bit sample of all lights leaves two bits or more unused and `input_bits` was not
/// given. The lights count together: one sensor took both.
pub(super) fn warning(lights: &[&FullScaleSlices<'_>]) -> Option<Warning> {
    let given = lights.iter().any(|light| light.bits != InputBits::Auto);
    let brightest =
        lights.iter().map(|light| light.brightest.load(Ordering::Relaxed)).max().filter(|&most| most > 0)?;
    let bits = SENSOR_BITS.into_iter().find(|bits| brightest < 1 << bits).filter(|_| !given)?;
    let detail = format!(
        "the brightest sample of the slices is {brightest} of {FULL_SCALE}: {bits}-bit data in 16-bit files? The image \
         reaches {:.1} % of full scale; send the stack with input_bits={bits} to scale it, or with input_bits=16 if it is \
         meant to be this dark",
        100.0 * f64::from(brightest) / f64::from(FULL_SCALE)
    );
    Some(Warning::new(WarningCode::UnusedInputBits, detail))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(most: u16) -> Vec<Raster> {
        (0..3).map(|n| Raster::sixteen(2, 2, 1, vec![0, 100, most / 2 + n, most])).collect()
    }

    fn samples(slices: &FullScaleSlices<'_>) -> Vec<u16> {
        match slices.load(0).unwrap().samples {
            Samples::Sixteen(samples) => samples,
            Samples::Eight(_) => panic!("16 bits"),
        }
    }

    #[test]
    fn samples_are_scaled_to_full_scale_on_request() {
        let stack = stack(4_095);
        let slices = stack.as_slice();
        assert_eq!(samples(&FullScaleSlices::of(&slices, InputBits::Twelve)), [0, 1_600, 32_759, 65_535]);
        for bits in [InputBits::Auto, InputBits::Sixteen] {
            assert_eq!(samples(&FullScaleSlices::of(&slices, bits)), [0, 100, 2_047, 4_095]);
        }
        let fault = FullScaleSlices::of(&slices, InputBits::Ten).load(1).unwrap_err();
        assert!(fault.kind == ErrorKind::InvalidImage && fault.detail.contains("4095"), "{}", fault.detail);
        assert_eq!(fault.locations[0].slice, Some(1));
    }

    #[test]
    fn unused_bits_cause_one_warning_for_all_lights() {
        let (dark, bright) = (stack(4_080), stack(60_000));
        let (dark, bright) = (dark.as_slice(), bright.as_slice());
        let loaded = |slices, bits| {
            let slices = FullScaleSlices::of(slices, bits);
            slices.load(0).unwrap();
            slices
        };
        let warned = warning(&[&loaded(&dark, InputBits::Auto)]).unwrap();
        assert!(
            warned.detail.contains("4080 of 65535: 12-bit") && warned.detail.contains("6.2 %"),
            "{}",
            warned.detail
        );
        // one sensor took both: the brighter light shows its number of bits
        assert_eq!(warning(&[&loaded(&dark, InputBits::Auto), &loaded(&bright, InputBits::Auto)]), None);
        assert_eq!(warning(&[&loaded(&dark, InputBits::Twelve)]), None);
        assert_eq!(warning(&[&loaded(&dark, InputBits::Sixteen)]), None);
        let eight = vec![Raster::eight(2, 1, 1, vec![0, 3])];
        assert_eq!(warning(&[&loaded(&eight.as_slice(), InputBits::Auto)]), None);
    }
}
