//! What a scene is made of: parts with a shape, a relief and a skin, before a background.

use super::{shape::Shape, skin::Skin};

/// One part of a scene: a surface that is a height field as seen from the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Its outline.
    pub shape: Shape,
    /// Round holes (centre, radius) through which farther parts are visible.
    pub holes: Vec<([f64; 2], f64)>,
    /// How deep each of its points lies.
    pub relief: Relief,
    /// Its colours.
    pub skin: Skin,
}

/// Depth of a part at every point of the picture, smooth and defined beyond the outline too.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Relief {
    /// A tilted plane with a dome that comes nearer in the middle.
    Dome {
        /// Middle of the dome.
        centre: [f64; 2],
        /// Depth of the plane at `centre`.
        depth: f64,
        /// Change of depth per unit of x and y.
        slope: [f64; 2],
        /// How much nearer the middle is than the plane.
        bulge: f64,
        /// Radius at which the dome has come down to the plane.
        radius: f64,
    },
    /// Depth that changes along a line and stays as it is beyond its ends.
    Along {
        /// One end.
        from: [f64; 2],
        /// The other end.
        to: [f64; 2],
        /// Depths at the ends.
        depths: [f64; 2],
    },
}

impl Relief {
    /// Depth fraction at (x, y).
    pub fn depth(&self, x: f64, y: f64) -> f64 {
        match *self {
            Self::Dome { centre, depth, slope, bulge, radius } => {
                let (dx, dy) = (x - centre[0], y - centre[1]);
                let height = (1.0 - (dx * dx + dy * dy) / (radius * radius)).max(0.0);
                depth + slope[0] * dx + slope[1] * dy - bulge * height
            }
            Self::Along { from, to, depths } => {
                let axis = [to[0] - from[0], to[1] - from[1]];
                let length_squared = (axis[0] * axis[0] + axis[1] * axis[1]).max(1e-12);
                let share = ((x - from[0]) * axis[0] + (y - from[1]) * axis[1]) / length_squared;
                depths[0] + (depths[1] - depths[0]) * share.clamp(0.0, 1.0)
            }
        }
    }

    /// The same depths over a picture that is `times` as large.
    fn scaled(self, times: f64) -> Self {
        let point = |point: [f64; 2]| point.map(|length| times * length);
        match self {
            Self::Dome { centre, depth, slope, bulge, radius } => Self::Dome {
                centre: point(centre),
                depth,
                slope: slope.map(|rise| rise / times),
                bulge,
                radius: times * radius,
            },
            Self::Along { from, to, depths } => Self::Along { from: point(from), to: point(to), depths },
        }
    }
}

/// An object of several parts before a plain background.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The parts, far ones first: each hides those before it in the list.
    pub parts: Vec<Part>,
    /// Colour of the background under front light, linear RGB 0..1.
    pub background: [f32; 3],
    /// How strongly the background is clouded, 0..1; it is far out of focus, so only softly.
    pub clouds: f32,
    /// Brightness of the back light, 0..1 of full scale.
    pub back_light: f32,
    /// How much the back light loses towards the corners of the picture, 0..1.
    pub back_light_falloff: f32,
    /// What is left of the light on the object's dark side under back light, 0..1 of full scale.
    pub shade: f32,
    /// Clouds follow from it.
    pub seed: u64,
}

impl Scene {
    pub(super) fn of(parts: Vec<Part>, background: [f32; 3], seed: u64) -> Self {
        Self { parts, background, clouds: 0.06, back_light: 0.9, back_light_falloff: 0.08, shade: 0.03, seed }
    }

    /// The same scene `times` as large in the picture, about its middle; depths stay. Below 1 it leaves a margin.
    #[must_use]
    pub fn scaled(mut self, times: f64) -> Self {
        for part in &mut self.parts {
            part.shape = part.shape.scaled(times);
            part.relief = part.relief.scaled(times);
            for (centre, radius) in &mut part.holes {
                *centre = centre.map(|length| times * length);
                *radius *= times;
            }
        }
        self
    }
}
