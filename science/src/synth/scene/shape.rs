//! Outlines as signed distance functions, with local coordinates and normals for shading.

use std::borrow::Cow;

/// A straight tapered hair, limb segment or stalk with round ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// One end.
    pub from: [f64; 2],
    /// The other end.
    pub to: [f64; 2],
    /// Radii at the ends.
    pub radii: [f64; 2],
}

/// An outline in scene coordinates.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// An ellipse.
    Ellipse {
        /// Its middle.
        centre: [f64; 2],
        /// Half axes.
        radii: [f64; 2],
        /// Turn of the first axis from x towards y, radians.
        angle: f64,
    },
    /// Any number of strokes.
    Strokes(Vec<Stroke>),
    /// A leaf or petal from base to tip.
    Blade {
        /// Base.
        from: [f64; 2],
        /// Tip.
        to: [f64; 2],
        /// Largest half width.
        half_width: f64,
        /// 0 is widest near the base, 1 near the tip.
        fullness: f64,
    },
    /// A rectangle with rounded corners.
    Plate {
        /// Its middle.
        centre: [f64; 2],
        /// Half sides.
        half: [f64; 2],
        /// Turn of the first side from x towards y, radians.
        angle: f64,
        /// Radius of the corners.
        corner: f64,
    },
}

impl Shape {
    /// The same outline `times` as large, about the middle of the picture.
    pub(super) fn scaled(&self, times: f64) -> Self {
        let point = |point: [f64; 2]| point.map(|length| times * length);
        match self {
            Self::Ellipse { centre, radii, angle } => {
                Self::Ellipse { centre: point(*centre), radii: point(*radii), angle: *angle }
            }
            Self::Strokes(strokes) => Self::Strokes(
                strokes
                    .iter()
                    .map(|s| Stroke { from: point(s.from), to: point(s.to), radii: point(s.radii) })
                    .collect(),
            ),
            Self::Blade { from, to, half_width, fullness } => {
                Self::Blade { from: point(*from), to: point(*to), half_width: times * half_width, fullness: *fullness }
            }
            Self::Plate { centre, half, angle, corner } => {
                Self::Plate { centre: point(*centre), half: point(*half), angle: *angle, corner: times * corner }
            }
        }
    }
}

/// A point on or near a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    /// Distance to the outline, negative inside.
    pub(crate) distance: f64,
    /// Slope of the surface that its roundness gives, -1..1 per axis: the x and y of the unit normal.
    pub(crate) normal: [f64; 2],
    /// Coordinates that lie in the shape: along its axis and across, in scene units.
    pub(crate) local: [f64; 2],
}

fn turned(point: [f64; 2], centre: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    let (dx, dy) = (point[0] - centre[0], point[1] - centre[1]);
    [dx * cos + dy * sin, dy * cos - dx * sin]
}

fn turned_back(vector: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [vector[0] * cos - vector[1] * sin, vector[0] * sin + vector[1] * cos]
}

impl Shape {
    /// Left, top, right and bottom of a box that holds the shape.
    pub(crate) fn bounds(&self) -> [f64; 4] {
        let around =
            |centre: [f64; 2], reach: f64| [centre[0] - reach, centre[1] - reach, centre[0] + reach, centre[1] + reach];
        match self {
            Self::Ellipse { centre, radii, .. } => around(*centre, radii[0].max(radii[1])),
            Self::Plate { centre, half, .. } => around(*centre, half[0].hypot(half[1])),
            Self::Blade { from, to, half_width, .. } => {
                let stroke = Stroke { from: *from, to: *to, radii: [*half_width; 2] };
                stroke.bounds()
            }
            Self::Strokes(strokes) => strokes
                .iter()
                .map(Stroke::bounds)
                .fold([f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY], |a, b| {
                    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
                }),
        }
    }

    /// What of the shape can matter to points of the row at `y`, give or take `reach`: only shapes of many
    /// strokes get simpler.
    pub(crate) fn near_row(&self, y: f64, reach: f64) -> Cow<'_, Self> {
        let Self::Strokes(strokes) = self else { return Cow::Borrowed(self) };
        let near = |stroke: &&Stroke| {
            let bounds = stroke.bounds();
            y >= bounds[1] - reach && y <= bounds[3] + reach
        };
        Cow::Owned(Self::Strokes(strokes.iter().filter(near).copied().collect()))
    }

    /// Where `point` lies relative to the outline; `None` if it is certainly farther than `reach` outside. Much cheaper
    /// than [`Shape::place`] for points far from the shape.
    pub(crate) fn place_within(&self, point: [f64; 2], reach: f64) -> Option<Place> {
        match self {
            Self::Strokes(strokes) => {
                let near = strokes.iter().filter(|stroke| stroke.is_near(point, reach));
                near.map(|stroke| stroke.place(point)).min_by(|a, b| a.distance.total_cmp(&b.distance))
            }
            Self::Blade { from, to, half_width, .. } => {
                let stroke = Stroke { from: *from, to: *to, radii: [*half_width; 2] };
                // within `reach` beyond the ends, and within `reach` and the largest half width beside the axis
                let reach = reach.hypot(reach + half_width) - half_width + 1e-9;
                (stroke.is_near(point, reach) && stroke.place(point).distance <= reach).then(|| self.place(point))
            }
            Self::Ellipse { .. } | Self::Plate { .. } => Some(self.place(point)),
        }
    }

    /// Where `point` lies relative to the outline.
    pub(crate) fn place(&self, point: [f64; 2]) -> Place {
        match self {
            Self::Ellipse { centre, radii, angle } => {
                let local = turned(point, *centre, *angle);
                let unit = [local[0] / radii[0], local[1] / radii[1]];
                let level = unit[0].hypot(unit[1]);
                // distance to first order: level over the length of its gradient
                let gradient = [unit[0] / radii[0], unit[1] / radii[1]];
                let steep = (gradient[0].hypot(gradient[1]) / level.max(1e-9)).max(1e-9);
                let distance = if level < 1e-9 { -radii[0].min(radii[1]) } else { (level - 1.0) / steep };
                Place { distance, normal: turned_back(unit, *angle), local }
            }
            Self::Strokes(strokes) => {
                let nearest =
                    strokes.iter().map(|stroke| stroke.place(point)).min_by(|a, b| a.distance.total_cmp(&b.distance));
                nearest.unwrap_or(Place { distance: f64::INFINITY, normal: [0.0; 2], local: [0.0; 2] })
            }
            Self::Blade { from, to, half_width, fullness } => {
                let axis = [to[0] - from[0], to[1] - from[1]];
                let length = axis[0].hypot(axis[1]).max(1e-9);
                let angle = axis[1].atan2(axis[0]);
                let local = turned(point, *from, angle);
                let t = (local[0] / length).clamp(0.0, 1.0);
                // a hump between 0 and 1 with its top at 0.35 (fullness 0) to 0.75 (fullness 1)
                let warped = t.powf((0.5_f64).ln() / (0.35 + 0.4 * fullness).ln());
                let width = half_width * (std::f64::consts::PI * warped).sin().max(0.0).powf(0.7);
                let beyond = (-local[0]).max(local[0] - length).max(0.0);
                let beside = local[1].abs() - width;
                let distance = if beyond > 0.0 { beyond.max(beside) } else { beside };
                let across = (local[1] / half_width).clamp(-1.0, 1.0);
                Place { distance, normal: turned_back([0.0, 0.55 * across], angle), local }
            }
            Self::Plate { centre, half, angle, corner } => {
                let local = turned(point, *centre, *angle);
                let outside = [local[0].abs() - half[0] + corner, local[1].abs() - half[1] + corner];
                let away = outside[0].max(0.0).hypot(outside[1].max(0.0));
                Place { distance: away + outside[0].max(outside[1]).min(0.0) - corner, normal: [0.0; 2], local }
            }
        }
    }
}

impl Stroke {
    /// False if `point` is certainly farther than `reach` outside.
    #[inline]
    fn is_near(&self, point: [f64; 2], reach: f64) -> bool {
        // rounding must not exclude a point
        let reach = self.radii[0].max(self.radii[1]) + reach + 1e-9;
        (0..2).all(|axis| {
            let (from, to) = (self.from[axis], self.to[axis]);
            point[axis] >= from.min(to) - reach && point[axis] <= from.max(to) + reach
        })
    }

    fn bounds(&self) -> [f64; 4] {
        let reach = self.radii[0].max(self.radii[1]);
        [
            self.from[0].min(self.to[0]) - reach,
            self.from[1].min(self.to[1]) - reach,
            self.from[0].max(self.to[0]) + reach,
            self.from[1].max(self.to[1]) + reach,
        ]
    }

    #[inline]
    fn place(&self, point: [f64; 2]) -> Place {
        let axis = [self.to[0] - self.from[0], self.to[1] - self.from[1]];
        let length_squared = (axis[0] * axis[0] + axis[1] * axis[1]).max(1e-12);
        let from = [point[0] - self.from[0], point[1] - self.from[1]];
        let t = ((from[0] * axis[0] + from[1] * axis[1]) / length_squared).clamp(0.0, 1.0);
        let off = [from[0] - t * axis[0], from[1] - t * axis[1]];
        let away = off[0].hypot(off[1]);
        let radius = self.radii[0] + t * (self.radii[1] - self.radii[0]);
        let slope = 0.95 / radius.max(1e-9);
        let side = (axis[0] * off[1] - axis[1] * off[0]).signum();
        Place {
            distance: away - radius,
            normal: [off[0] * slope, off[1] * slope],
            local: [t * length_squared.sqrt(), side * away],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_within_reach_gets_its_place_and_only_farther_ones_get_none() {
        let stroke = |x: f64| Stroke { from: [x, -0.2], to: [0.5 * x, 0.3], radii: [0.02, 0.002] };
        let shapes = [
            Shape::Strokes((0..8).map(|k| stroke(0.1 * f64::from(k) - 0.4)).collect()),
            Shape::Blade { from: [-0.3, 0.1], to: [0.35, -0.05], half_width: 0.12, fullness: 0.6 },
            Shape::Ellipse { centre: [0.1, 0.0], radii: [0.3, 0.1], angle: 0.4 },
            Shape::Plate { centre: [0.0, 0.1], half: [0.2, 0.1], angle: 1.1, corner: 0.03 },
        ];
        for shape in &shapes {
            for k in 0..4_000_u32 {
                let point = [f64::from(k % 80) / 50.0 - 0.8, f64::from(k / 80) / 30.0 - 0.8];
                for reach in [0.002, 0.1] {
                    let place = shape.place(point);
                    match shape.place_within(point, reach) {
                        Some(found) => assert!(found == place || place.distance > reach, "{shape:?} {point:?}"),
                        None => assert!(place.distance > reach, "{shape:?} {point:?}"),
                    }
                }
            }
        }
    }
}
