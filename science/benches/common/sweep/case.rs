//! The cases: a typical one, each factor alone, and random combinations of all factors.

use pinstack_science::synth::{DotTarget, Flaws, Glare, Rig, Surround};

/// How much of the image the grid covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Extent {
    /// All of it, and beyond.
    Beyond,
    /// It ends inside the image, on a table.
    Inside,
    /// About a third of the image, with a black frame around it.
    Third,
}

/// A stack with its defects.
#[derive(Debug, Clone)]
pub struct Case {
    /// Name, for the tables.
    pub name: String,
    pub size: [usize; 2],
    pub slices: usize,
    /// Pitch in the reference slice, px.
    pub pitch: f64,
    /// Dot diameter over pitch.
    pub fill: f64,
    /// Largest blur radius in the stack, over the pitch.
    pub blur: f64,
    pub noise: f64,
    pub vignetting: f64,
    /// Tilt of the target about both axes, degrees.
    pub tilt: f64,
    /// Drift, rotation and keystone, as multiples of those of `Rig::sized`.
    pub motion: f64,
    pub extent: Extent,
    pub rotation: f64,
    pub invert: bool,
    pub missing: f64,
    pub dust: bool,
    pub glare: bool,
    pub gamma: bool,
    pub exposure_falls: bool,
    /// Depth of the target as a fraction of the stack; 0.5 is the reference slice's.
    pub focus: f64,
    pub asymmetric: bool,
    /// Pupil ratio of the lens.
    pub pupil_ratio: f64,
    pub seed: u64,
}

impl Case {
    fn typical(seed: u64) -> Self {
        Self {
            name: "typical".into(),
            size: [900, 600],
            slices: 11,
            pitch: 36.0,
            fill: 0.5,
            blur: 0.4,
            noise: 2.0,
            vignetting: 0.25,
            tilt: 0.0,
            motion: 1.0,
            extent: Extent::Beyond,
            rotation: 0.7,
            invert: false,
            missing: 0.0,
            dust: false,
            glare: false,
            gamma: false,
            exposure_falls: true,
            focus: 0.5,
            asymmetric: false,
            pupil_ratio: 1.0,
            seed,
        }
    }

    /// All factors in short form.
    pub fn factors(&self) -> String {
        let mut words = vec![
            format!("{}x{}x{}", self.size[0], self.size[1], self.slices),
            format!("pitch {:.0}", self.pitch),
            format!("fill {}", self.fill),
            format!("blur {}", self.blur),
            format!("noise {}", self.noise),
            format!("vign {}", self.vignetting),
            format!("{:?}", self.extent).to_lowercase(),
            format!("rot {}", self.rotation),
        ];
        let odd = [
            (self.tilt != 0.0, "tilt"),
            (self.motion > 1.0, "motion"),
            (self.invert, "bright-dots"),
            (self.missing > 0.0, "missing"),
            (self.dust, "dust"),
            (self.glare, "glare"),
            (self.gamma, "gamma"),
            (!self.exposure_falls, "even-exposure"),
            (self.focus != 0.5, "focus-elsewhere"),
            (self.asymmetric, "asymmetric"),
            (self.pupil_ratio != 1.0, "pupils"),
        ];
        words.extend(odd.into_iter().filter(|word| word.0).map(|word| word.1.to_owned()));
        words.push(format!("seed {}", self.seed));
        words.join(" ")
    }

    /// The rig and its target.
    pub fn build(&self) -> (Rig, DotTarget) {
        let plain = Rig::sized(self.size[0], self.size[1], self.slices);
        let mut rig = Rig {
            pupil_ratio: self.pupil_ratio,
            noise: self.noise,
            vignetting: self.vignetting,
            drift_px: plain.drift_px.map(|px| px * self.motion),
            rotation_deg: plain.rotation_deg * self.motion,
            keystone: plain.keystone.map(|share| share * self.motion),
            exposure_falls: self.exposure_falls,
            channels: 1,
            seed: self.seed,
            ..plain
        };
        let depth = (self.focus != 0.5).then_some(self.focus);
        let mut target = DotTarget {
            rotation_deg: self.rotation,
            invert: self.invert,
            depth,
            asymmetric: self.asymmetric,
            tilt_deg: [self.tilt, -0.7 * self.tilt],
            ..DotTarget::for_rig(&rig, 20)
        };
        target.pitch_mm *= self.pitch / target.pitch_px(&rig, rig.reference);
        // neighbours of a symmetric grid are one pitch apart, those of an asymmetric one 0.71 of it
        let spacing = if self.asymmetric { std::f64::consts::FRAC_1_SQRT_2 } else { 1.0 };
        target.dot_diameter_mm = self.fill * spacing * target.pitch_mm;
        [target.columns, target.rows] = self.grid();
        let largest = [0, self.slices - 1].map(|i| target.blur_radius_px(&rig, i) / target.pitch_px(&rig, i));
        rig.f_number *= largest[0].max(largest[1]) / (self.blur * spacing);
        if self.missing > 0.0 {
            target = target.without(self.missing, self.seed);
        }
        let surround = match self.extent {
            Extent::Beyond => None,
            Extent::Inside => Some(Surround::table()),
            Extent::Third => Some(Surround::framed()),
        };
        let lamp = |at: [f64; 2], light: f64| Glare { at, radius: 0.12, light };
        target.flaws = Flaws {
            target_dust: if self.dust { 40 } else { 0 },
            sensor_dust: if self.dust { 12 } else { 0 },
            glare: if self.glare { vec![lamp([0.3, 0.35], 0.5), lamp([0.75, 0.7], 0.2)] } else { Vec::new() },
            surround,
            gamma: self.gamma,
            seed: self.seed,
            ..Flaws::default()
        };
        (rig, target)
    }

    /// Columns and rows such that the rotated grid covers the specified extent in every slice.
    fn grid(&self) -> [usize; 2] {
        let [width, height] = self.size.map(|side| side as f64 / self.pitch);
        let (sin, cos) = self.rotation.to_radians().sin_cos();
        let turned =
            |across: f64, down: f64| [across * cos.abs() + down * sin.abs(), across * sin.abs() + down * cos.abs()];
        let share = match self.extent {
            Extent::Beyond => {
                let reach = turned(width, height).map(|side| side as usize + 4);
                return self.in_dots(reach);
            }
            Extent::Inside => 0.82,
            Extent::Third => 0.58,
        };
        // the largest grid that fits: both sides shrink together
        let mut sides = if self.rotation.abs() > 60.0 { [height, width] } else { [width, height] };
        loop {
            let box_of = turned(sides[0], sides[1]);
            if box_of[0] <= share * width && box_of[1] <= share * height {
                return self.in_dots(sides.map(|side| side as usize + 1));
            }
            sides = sides.map(|side| side * 0.97);
        }
    }

    /// Rows of an asymmetric grid are half a pitch apart.
    fn in_dots(&self, [columns, rows]: [usize; 2]) -> [usize; 2] {
        [columns.max(4), rows.max(4) * if self.asymmetric { 2 } else { 1 }]
    }
}

type Change = fn(&mut Case);

/// Each factor alone.
const CHANGES: [(&str, Change); 33] = [
    ("typical", |_| {}),
    ("blur 0.15", |c| c.blur = 0.15),
    ("blur 0.3", |c| c.blur = 0.3),
    ("blur 0.45", |c| c.blur = 0.45),
    ("blur 0.55", |c| c.blur = 0.55),
    ("blur 0.7", |c| c.blur = 0.7),
    ("noise 1", |c| c.noise = 1.0),
    ("noise 4", |c| c.noise = 4.0),
    ("no vignetting", |c| c.vignetting = 0.0),
    ("vignetting 0.4", |c| c.vignetting = 0.4),
    ("tilt", |c| c.tilt = 1.5),
    ("strong motion", |c| c.motion = 4.0),
    ("ends inside", |c| c.extent = Extent::Inside),
    ("a third", |c| c.extent = Extent::Third),
    ("rotation 17", |c| c.rotation = 17.0),
    ("rotation 45", |c| c.rotation = 45.0),
    ("rotation 90", |c| c.rotation = 90.0),
    ("bright dots", |c| c.invert = true),
    ("missing dots", |c| c.missing = 0.08),
    ("dust", |c| c.dust = true),
    ("glare", |c| c.glare = true),
    ("gamma", |c| c.gamma = true),
    ("even exposure", |c| c.exposure_falls = false),
    ("pitch 24", |c| c.pitch = 24.0),
    ("pitch 70", |c| c.pitch = 70.0),
    ("small dots", |c| c.fill = 0.35),
    ("large dots", |c| c.fill = 0.6),
    ("focus elsewhere", |c| c.focus = 0.2),
    ("asymmetric", |c| c.asymmetric = true),
    ("pupil ratio 0.6", |c| c.pupil_ratio = 0.6),
    ("pupil ratio 1.8", |c| c.pupil_ratio = 1.8),
    ("13 slices", |c| c.slices = 13),
    ("1500 x 1000", |c| {
        c.size = [1500, 1000];
        c.slices = 9;
    }),
];

/// `seeds` cases of each factor alone, then `random` combinations drawn from `seed`.
pub fn cases(seeds: u64, random: usize, seed: u64) -> Vec<Case> {
    let alone = CHANGES.iter().flat_map(|(name, change)| {
        (0..seeds).map(move |k| {
            let mut case = Case { name: (*name).to_owned(), ..Case::typical(seed + k) };
            change(&mut case);
            case
        })
    });
    let mut draw = Draw(seed ^ 0x5eed_ca5e);
    alone.chain((0..random).map(|index| random_case(index, seed, &mut draw))).collect()
}

fn random_case(index: usize, seed: u64, draw: &mut Draw) -> Case {
    let large = draw.chance(0.1);
    Case {
        name: format!("random {index}"),
        size: if large { [1500, 1000] } else { [900, 600] },
        slices: if large { 9 } else { 9 + draw.below(5) },
        pitch: 24.0 + 46.0 * draw.unit().powi(2),
        fill: draw.of(&[0.5, 0.5, 0.35, 0.6]),
        blur: draw.of(&[0.15, 0.3, 0.4, 0.45, 0.55, 0.7]),
        noise: draw.of(&[1.0, 2.0, 4.0]),
        vignetting: draw.of(&[0.0, 0.25, 0.4]),
        tilt: draw.of(&[0.0, 1.5]),
        motion: draw.of(&[1.0, 1.0, 4.0]),
        extent: draw.of(&[Extent::Beyond, Extent::Inside, Extent::Third]),
        rotation: draw.of(&[0.7, 17.0, 45.0, 90.0]),
        invert: draw.chance(0.25),
        missing: draw.of(&[0.0, 0.08]),
        dust: draw.chance(0.4),
        glare: draw.chance(0.25),
        gamma: draw.chance(0.5),
        exposure_falls: draw.chance(0.8),
        focus: draw.of(&[0.5, 0.5, 0.25, 0.7]),
        asymmetric: false,
        pupil_ratio: draw.of(&[0.6, 1.0, 1.8]),
        seed: seed + 100 + index as u64,
    }
}

/// SplitMix64.
struct Draw(u64);

impl Draw {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    fn chance(&mut self, share: f64) -> bool {
        self.unit() < share
    }
}
