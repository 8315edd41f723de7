//! Hash noise: pseudo-random numbers that are functions of their key. The result depends neither on the order of
//! evaluation nor on threads.

/// The finaliser of SplitMix64: every input bit affects every output bit.
#[inline]
pub(super) fn mix(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A key made from several numbers; their order matters.
#[inline]
pub(super) fn key(parts: &[u64]) -> u64 {
    parts.iter().fold(0x5eed, |state, &part| mix(state ^ part))
}

/// Uniform in 0..1.
#[inline]
pub(super) fn uniform(key: u64) -> f64 {
    (mix(key) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Uniform in `low..high`.
#[inline]
pub(super) fn between(key: u64, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(key)
}

/// Approximately normal: mean 0, standard deviation 1, within +-3.46. The sum of four uniform numbers is sufficient for
/// sensor noise, and much cheaper than an exact Gaussian.
#[inline]
pub(super) fn normal(key: u64) -> f32 {
    let bits = mix(key);
    let sum = (bits & 0xffff) + ((bits >> 16) & 0xffff) + ((bits >> 32) & 0xffff) + (bits >> 48);
    const SQRT_3: f32 = 1.732_050_8;
    ((sum as f32 + 2.0) / 65_536.0 - 2.0) * SQRT_3
}

/// Value noise, -1..1: a random number at each point of the unit lattice, smoothly interpolated.
pub(super) fn lattice(seed: u64, x: f64, y: f64) -> f32 {
    let (floor_x, floor_y) = (x.floor(), y.floor());
    let (left, top) = (floor_x as i64 as u64, floor_y as i64 as u64);
    let corner = |dx: u64, dy: u64| {
        let at = seed ^ left.wrapping_add(dx).wrapping_mul(0x9e37_79b1_85eb_ca87);
        (mix(at ^ top.wrapping_add(dy).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)) >> 40) as f32 / 8_388_608.0 - 1.0
    };
    let smooth = |t: f64| (t * t * (3.0 - 2.0 * t)) as f32;
    let (tx, ty) = (smooth(x - floor_x), smooth(y - floor_y));
    let upper = corner(0, 0) * (1.0 - tx) + corner(1, 0) * tx;
    let lower = corner(0, 1) * (1.0 - tx) + corner(1, 1) * tx;
    upper * (1.0 - ty) + lower * ty
}

/// The same in space.
pub(super) fn lattice_3d(seed: u64, point: [f64; 3]) -> f32 {
    let floor = point.map(f64::floor);
    let cell = floor.map(|whole| whole as i64 as u64);
    let [tx, ty, tz]: [f32; 3] = std::array::from_fn(|axis| {
        let t = point[axis] - floor[axis];
        (t * t * (3.0 - 2.0 * t)) as f32
    });
    let corner = |dx: u64, dy: u64, dz: u64| {
        let at = seed ^ cell[0].wrapping_add(dx).wrapping_mul(0x9e37_79b1_85eb_ca87);
        let at = at ^ cell[1].wrapping_add(dy).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
        (mix(at ^ cell[2].wrapping_add(dz).wrapping_mul(0x1656_67b1_9e37_79f9)) >> 40) as f32 / 8_388_608.0 - 1.0
    };
    let along_x = |dy: u64, dz: u64| corner(0, dy, dz) * (1.0 - tx) + corner(1, dy, dz) * tx;
    let plane = |dz: u64| along_x(0, dz) * (1.0 - ty) + along_x(1, dz) * ty;
    plane(0) * (1.0 - tz) + plane(1) * tz
}

/// Fractal noise, about -1..1: octaves of value noise, each `roughness` times as strong as the one before. Octaves
/// finer than `finest` (in units of `x`) fade out to avoid aliasing.
pub(super) fn fractal(seed: u64, x: f64, y: f64, octaves: u32, roughness: f32, finest: f64) -> f32 {
    let (mut sum, mut total, mut strength, mut frequency) = (0.0, 0.0, 1.0, 1.0_f64);
    for octave in 0..octaves {
        let visible = (1.0 / frequency / finest - 1.0).clamp(0.0, 1.0) as f32;
        if visible > 0.0 {
            sum += strength * visible * lattice(seed.wrapping_add(u64::from(octave)), x * frequency, y * frequency);
        }
        total += strength;
        strength *= roughness;
        frequency *= 2.03;
    }
    1.6 * sum / total
}
