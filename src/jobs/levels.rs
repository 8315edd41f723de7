//! Slices whose 16-bit files hold fewer bits: brought to full scale when that is asked for, and told when it is not.

use std::sync::atomic::{AtomicU32, Ordering};

use crate::contract::input::InputBits;
use pinstack_science::{
    imaging::{Raster, Samples, Slices},
    types::{Error, ErrorKind, Warning},
};

/// Full scale of 16 bits.
const FULL: u32 = 65_535;
/// Numbers of bits that cameras have, beside 8 and 16.
const USUAL: [u32; 3] = [10, 12, 14];

/// The slices of one light, with their samples brought to full scale and the brightest of them noted.
pub(super) struct Levels<'a> {
    slices: &'a dyn Slices,
    bits: InputBits,
    /// Brightest sample of 16 bits as it is in the files; 0 until one was seen.
    brightest: AtomicU32,
}

impl<'a> Levels<'a> {
    /// `slices`, of which files of 16 bits have as many bits as `bits` says.
    pub(super) fn of(slices: &'a dyn Slices, bits: InputBits) -> Self {
        Self { slices, bits, brightest: AtomicU32::new(0) }
    }

    fn scaled(&self, samples: &mut [u16], brightest: u32, index: usize) -> Result<(), Error> {
        let Some(bits) = self.bits.bits().filter(|&bits| bits < 16) else { return Ok(()) };
        let full = (1u32 << bits) - 1;
        if brightest > full {
            let name = self.name(index);
            let detail = format!(
                "input_bits={bits}, but {name} has samples up to {brightest}, more than {full}; send the stack with \
                 the right number of bits, or without input_bits"
            );
            return Err(Error::new(ErrorKind::InvalidImage, detail).in_file(name, u32::try_from(index).ok()));
        }
        // the quotient is at most FULL
        samples.iter_mut().for_each(|sample| *sample = ((u32::from(*sample) * FULL + full / 2) / full) as u16);
        Ok(())
    }
}

impl Slices for Levels<'_> {
    fn count(&self) -> usize {
        self.slices.count()
    }

    fn name(&self, index: usize) -> &str {
        self.slices.name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        let mut raster = self.slices.load(index)?;
        if let Samples::Sixteen(samples) = &mut raster.samples {
            let brightest = u32::from(samples.iter().copied().max().unwrap_or(0));
            self.brightest.fetch_max(brightest, Ordering::Relaxed);
            self.scaled(samples, brightest, index)?;
        }
        Ok(raster)
    }
}

/// What is to be said of the levels of slices that were loaded: a warning when the brightest sample of 16 bits leaves
/// two bits or more unused and nothing was said about that.
pub(super) fn warning(lights: &[&Levels<'_>]) -> Option<Warning> {
    let asked = lights.iter().any(|light| light.bits != InputBits::Auto);
    let brightest =
        lights.iter().map(|light| light.brightest.load(Ordering::Relaxed)).max().filter(|&most| most > 0)?;
    let bits = USUAL.into_iter().find(|bits| brightest < 1 << bits).filter(|_| !asked)?;
    let detail = format!(
        "the slices use {brightest} of {FULL}: {bits}-bit data in 16-bit files? The picture is at most {:.1} % of \
         full scale; send the stack with input_bits={bits} to bring it there, or with input_bits=16 if it is meant to be this dark",
        100.0 * f64::from(brightest) / f64::from(FULL)
    );
    Some(Warning::new("unused_input_bits", detail))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(most: u16) -> Vec<Raster> {
        (0..3).map(|n| Raster::sixteen(2, 2, 1, vec![0, 100, most / 2 + n, most])).collect()
    }

    fn samples(levels: &Levels<'_>) -> Vec<u16> {
        match levels.load(0).unwrap().samples {
            Samples::Sixteen(samples) => samples,
            Samples::Eight(_) => panic!("16 bits"),
        }
    }

    #[test]
    fn samples_are_stretched_to_full_scale_when_that_is_asked_for() {
        let stack = stack(4_095);
        let slices = stack.as_slice();
        assert_eq!(samples(&Levels::of(&slices, InputBits::Twelve)), [0, 1_600, 32_759, 65_535]);
        for bits in [InputBits::Auto, InputBits::Sixteen] {
            assert_eq!(samples(&Levels::of(&slices, bits)), [0, 100, 2_047, 4_095]);
        }
        let fault = Levels::of(&slices, InputBits::Ten).load(1).unwrap_err();
        assert!(fault.kind == ErrorKind::InvalidImage && fault.detail.contains("4095"), "{}", fault.detail);
        assert_eq!(fault.locations[0].slice, Some(1));
    }

    #[test]
    fn unused_bits_are_told_of_all_lights_together() {
        let (dark, bright) = (stack(4_080), stack(60_000));
        let (dark, bright) = (dark.as_slice(), bright.as_slice());
        let loaded = |slices, bits| {
            let levels = Levels::of(slices, bits);
            levels.load(0).unwrap();
            levels
        };
        let told = warning(&[&loaded(&dark, InputBits::Auto)]).unwrap();
        assert!(told.detail.contains("4080 of 65535: 12-bit") && told.detail.contains("6.2 %"), "{}", told.detail);
        // one sensor took both, so that the brighter light tells how many bits it has
        assert_eq!(warning(&[&loaded(&dark, InputBits::Auto), &loaded(&bright, InputBits::Auto)]), None);
        assert_eq!(warning(&[&loaded(&dark, InputBits::Twelve)]), None);
        assert_eq!(warning(&[&loaded(&dark, InputBits::Sixteen)]), None);
        let eight = vec![Raster::eight(2, 1, 1, vec![0, 3])];
        assert_eq!(warning(&[&loaded(&eight.as_slice(), InputBits::Auto)]), None);
    }
}
