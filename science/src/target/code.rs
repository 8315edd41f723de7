//! The code of the dot target: each dot is small or large.
//!
//! Input: column and row of a dot. Output: its size. Why two sizes, and not missing dots: a pattern of missing dots, no
//! two of them adjacent, carries at most 0.425 bits per dot (the entropy constant of non-attacking kings), so a view of
//! 60 dots cannot be told from chance. Two sizes carry one bit per dot, and every dot can be measured.

/// Version of the code. A version never changes; another pattern gets another number.
pub const CODE_VERSION: u32 = 1;

/// The pattern repeats after this many columns and after this many rows.
pub const CODE_PERIOD: u32 = 256;

/// The definition in one paragraph, for the documentation of a printed target.
pub const CODE_DESCRIPTION: &str = "pinstack dot code, version 1: dots on a square grid, columns counted to the right \
    and rows downwards from 0. The dot in column c and row r is large if the most significant bit of output number \
    256 (r mod 256) + (c mod 256) (counted from 0) of the generator SplitMix64 with seed 44 is 1, else small. A large \
    dot is 1.12 times and a small one 0.84 times as wide as the nominal dot, which is half as wide as the pitch unless \
    dot_ratio says otherwise.";

/// Seed of the pattern. With it, every two windows of 7 x 7 dots, rotated and mirrored ones included, differ in at
/// least 4 dots; it is the first seed with this property.
const SEED: u64 = 44;

/// Size of a dot of a coded target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DotSize {
    /// The code has a 0.
    Small,
    /// The code has a 1.
    Large,
}

impl DotSize {
    /// Diameter over the nominal diameter. The mean area of both sizes is 0.98 of the nominal one.
    pub fn factor(self) -> f64 {
        match self {
            Self::Small => 0.84,
            Self::Large => 1.12,
        }
    }

    /// 1 for a large dot, -1 for a small one.
    pub fn sign(self) -> f64 {
        match self {
            Self::Small => -1.0,
            Self::Large => 1.0,
        }
    }
}

/// Size of the dot in `column` and `row`. The pattern repeats with [`CODE_PERIOD`] in both directions.
pub fn dot_size(column: i64, row: i64) -> DotSize {
    let period = i64::from(CODE_PERIOD);
    let index = period * row.rem_euclid(period) + column.rem_euclid(period);
    if split_mix(SEED, index as u64) >> 63 == 1 { DotSize::Large } else { DotSize::Small }
}

/// Output number `index`, counted from 0, of SplitMix64 (Steele, Lea and Flood, 2014) with this seed.
fn split_mix(seed: u64, index: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(index + 1));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Side of the windows that the code tells apart, dots.
    const SIDE: usize = 7;
    const PERIOD: usize = CODE_PERIOD as usize;

    #[test]
    fn the_generator_is_splitmix64() {
        // the first outputs for seed 0 and 1234567, from the reference implementation
        assert_eq!(split_mix(0, 0), 0xE220_A839_7B1D_CDAF);
        assert_eq!([0, 1].map(|n| split_mix(1_234_567, n)), [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
    }

    #[test]
    fn the_first_row_of_the_printed_pattern_never_changes() {
        let row =
            |r: i64| (0..32).map(|c| if dot_size(c, r) == DotSize::Large { '1' } else { '0' }).collect::<String>();
        assert_eq!([row(0), row(1)], ["11010011010011000001110100001010", "11000111101111100110011001101111"]);
        assert_eq!(dot_size(-3, 5), dot_size(253, 261));
    }

    #[test]
    fn windows_of_seven_by_seven_dots_differ_in_at_least_four_of_them_however_they_are_turned() {
        let bits: Vec<u64> = (0..PERIOD * PERIOD)
            .map(|k| u64::from(dot_size((k % PERIOD) as i64, (k / PERIOD) as i64) == DotSize::Large))
            .collect();
        let window = |x: usize, y: usize| {
            let cell = |k: usize| bits[(y + k / SIDE) % PERIOD * PERIOD + (x + k % SIDE) % PERIOD];
            (0..SIDE * SIDE).fold(0, |word, k| word | cell(k) << k)
        };
        let upright: Vec<u64> = (0..PERIOD * PERIOD).map(|k| window(k % PERIOD, k / PERIOD)).collect();
        // where each symmetry takes the cells of a window from
        let sources: Vec<Vec<usize>> = (0..8_usize)
            .map(|symmetry| {
                let flip = |v: usize, bit: usize| if symmetry & bit == 0 { v } else { SIDE - 1 - v };
                let source = |k: usize| {
                    let (x, y) = (flip(k % SIDE, 1), flip(k / SIDE, 2));
                    if symmetry & 4 == 0 { y * SIDE + x } else { x * SIDE + y }
                };
                (0..SIDE * SIDE).map(source).collect()
            })
            .collect();
        let turned =
            |word: u64, sources: &[usize]| sources.iter().enumerate().fold(0, |w, (k, s)| w | (word >> s & 1) << k);
        let all: Vec<u64> = sources.iter().flat_map(|s| upright.iter().map(move |w| turned(*w, s))).collect();
        // two windows that differ in at most 3 cells agree in one of these four parts
        for (shift, size) in [(0, 12), (12, 12), (24, 12), (36, 13)] {
            let part = |word: u64| (word >> shift & ((1 << size) - 1)) as usize;
            let mut lists = vec![Vec::new(); 1 << size];
            all.iter().enumerate().for_each(|(k, word)| lists[part(*word)].push((k, *word)));
            for (k, word) in upright.iter().enumerate() {
                let near = lists[part(*word)].iter().find(|(other, w)| *other != k && (w ^ word).count_ones() < 4);
                assert_eq!(near, None, "window {k}");
            }
        }
    }
}
