//! The visual hull of a scan: a closed, coloured surface from the masks and the camera poses of its views.
//!
//! In: cameras, and the mask and picture of each ([`ViewPictures`]). Out: a [`Hull`]. The visual hull is the largest
//! body with these silhouettes (Laurentini 1994): the object and what no view can tell from it, such as hollows that no
//! outline shows. No detail of the surface is needed, so it works where stereo does not: on smooth or shiny objects,
//! and with few views.
//!
//! | module | what it does |
//! |---|---|
//! | `silhouette` | mask -> signed distance to its outline |
//! | `bounds` | where the object is |
//! | `consistency` | views whose mask contradicts the others |
//! | `octree` | which blocks of space the surface can pass |
//! | `surface`, `cubes` | marching cubes in these blocks: a closed, manifold mesh |
//! | [`mesh`] | volume, area, normals, connected parts |
//! | `colours` | colours from the views that see a vertex best |
//! | `files` | PLY and GLB |

mod bounds;
mod colours;
mod consistency;
mod cubes;
mod files;
pub mod mesh;
mod octree;
mod silhouette;
mod surface;

#[cfg(test)]
mod tests;

use rayon::prelude::*;
use serde::Serialize;

pub use files::{write_glb, write_ply};
pub use mesh::Mesh;

use self::{
    colours::Colouring,
    octree::{Grid, Octree},
    silhouette::Silhouette,
};
use crate::{
    imaging::{Plane, Raster},
    types::{Control, Error, Interrupted, error::ErrorKind, pinhole::PinholeCamera},
};

/// Cells along the longest side of the hull, unless the pictures have fewer pixels there.
pub const DEFAULT_RESOLUTION: usize = 512;
/// Most cells along a side.
pub const MAX_RESOLUTION: usize = 2048;
/// Most views.
pub const MAX_VIEWS: usize = 10_000;
/// Fewest views with an object.
const LEAST_VIEWS: usize = 3;
/// Pixels of a reduced mask per cell, at most.
const PIXELS_PER_CELL: f64 = 1.5;
/// Cells between the hull and the border of the grid.
const BORDER_CELLS: f64 = 4.0;

/// Silhouettes with the indices of their views.
type Numbered = Vec<(usize, Silhouette)>;

/// The masks and pictures of the views. Each is asked for once, so they need not be in memory together.
pub trait ViewPictures: Sync {
    /// The mask of a view, of the size of its camera: 255 where the object is, with soft edges if there are any.
    ///
    /// # Errors
    /// When it cannot be read.
    fn mask(&self, view: usize) -> Result<Plane<u8>, Error>;

    /// The picture of a view, of the size of its camera; `None` if it has none. Called only if colours are wanted.
    ///
    /// # Errors
    /// When it cannot be read.
    fn picture(&self, view: usize) -> Result<Option<Raster>, Error>;
}

/// How a hull is made.
#[derive(Debug, Clone, PartialEq)]
pub struct HullOptions {
    /// Cells along the longest side of the hull, 16 to [`MAX_RESOLUTION`]; `None`: [`DEFAULT_RESOLUTION`], or what the
    /// pixels of the finest view have there, if that is less.
    pub resolution: Option<usize>,
    /// A point is kept if at most so many views see it outside of their silhouette, 0 to 3.
    pub tolerated: usize,
    /// Views whose mask contradicts the others are left out, of eight views or more. Their masks or poses are wrong.
    pub leave_out: bool,
    /// Parts with less than this share of the volume of the largest are removed.
    pub least_part: f64,
    /// Length of the unit of the poses, mm; `None` if it is unknown.
    pub mm_per_unit: Option<f64>,
    /// Whether the vertices get colours.
    pub colours: bool,
}

impl Default for HullOptions {
    fn default() -> Self {
        Self { resolution: None, tolerated: 0, leave_out: true, least_part: 1e-5, mm_per_unit: None, colours: true }
    }
}

/// A visual hull. Lengths are in mm if the scale is known, otherwise in the unit of the poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Hull {
    /// Its surface.
    pub mesh: Mesh,
    /// What is known about it.
    pub summary: HullSummary,
}

/// Figures of a visual hull.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HullSummary {
    /// Whether lengths are in mm; otherwise they are in the unit of the poses.
    pub is_mm: bool,
    /// Volume within the surface.
    pub volume: f64,
    /// Area of the surface.
    pub area: f64,
    /// Sides of its bounding box along x, y and z.
    pub size: [f64; 3],
    /// Side of a cell.
    pub cell: f64,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Small parts that were removed.
    pub removed_parts: usize,
    /// Views whose mask has no object; they were left out, by their index.
    pub empty_views: Vec<usize>,
    /// Views whose mask contradicts the others; they were left out, by their index.
    pub contradicting_views: Vec<usize>,
}

/// The visual hull of the views with these cameras.
///
/// A ball of radius 1 mm, seen from 24 directions at a distance of 10 mm:
///
/// ```
/// use pinstack_science::{
///     hull::{HullOptions, ViewPictures, from_views},
///     imaging::{Plane, Raster},
///     types::{Error, NoControl, pinhole::PinholeCamera, view::ViewAngles},
/// };
///
/// struct Masks;
///
/// impl ViewPictures for Masks {
///     fn mask(&self, _view: usize) -> Result<Plane<u8>, Error> {
///         let radius_px = 500.0 / 99_f64.sqrt();
///         let is_inside = |x: usize, y: usize| (x as f64 - 99.5).hypot(y as f64 - 99.5) < radius_px;
///         Ok(Plane::from_fn(200, 200, |x, y| if is_inside(x, y) { 255 } else { 0 }))
///     }
///     fn picture(&self, _view: usize) -> Result<Option<Raster>, Error> {
///         Ok(None)
///     }
/// }
///
/// let angles =
///     (0..24).map(|at| ViewAngles { pan_deg: 30.0 * f64::from(at), tilt_deg: if at < 12 { 0.0 } else { 45.0 } });
/// let cameras: Vec<PinholeCamera> = angles
///     .map(|angles| PinholeCamera {
///         rotation: angles.rotation(),
///         centre: angles.direction().map(|x| 10.0 * x),
///         focal_px: [500.0; 2],
///         principal_point_px: [99.5; 2],
///         radial: [0.0; 2],
///         size: [200; 2],
///     })
///     .collect();
/// let hull = from_views(&cameras, &Masks, &HullOptions::default(), &NoControl)?;
/// let ball = 4.0 / 3.0 * std::f64::consts::PI;
/// assert!((0.99..1.1).contains(&(hull.summary.volume / ball)), "{}", hull.summary.volume);
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
///
/// # Errors
/// [`Interrupted::Failed`] with [`ErrorKind::InvalidParameter`] for options out of range,
/// [`ErrorKind::SizeMismatch`] for a mask or picture of another size than its camera, [`ErrorKind::InvalidPoses`] with
/// fewer than three views, when all look the same way, and when nothing is within all silhouettes, and the errors of
/// `pictures`; [`Interrupted::Cancelled`] when `control` says so.
pub fn from_views(
    cameras: &[PinholeCamera],
    pictures: &dyn ViewPictures,
    options: &HullOptions,
    control: &dyn Control,
) -> Result<Hull, Interrupted> {
    check(cameras, options)?;
    let resolution = options.resolution.unwrap_or(DEFAULT_RESOLUTION);
    let (mut silhouettes, empty_views) = silhouettes(cameras, pictures, resolution, control)?;
    let contradicting_views = if options.leave_out { leave_out(&mut silhouettes)? } else { Vec::new() };
    control.check()?;
    let (used, silhouettes): (Vec<usize>, Vec<Silhouette>) = silhouettes.into_iter().unzip();
    let (middle, longest) = bounds::bounds(&silhouettes, options.tolerated)?;
    let finest = silhouettes.iter().map(|silhouette| pixel_size(silhouette, middle)).fold(f64::INFINITY, f64::min);
    let cell = match options.resolution {
        Some(cells) => longest / cells as f64,
        None => (longest / resolution as f64).max(finest),
    };
    control.check()?;
    let octree = Octree { silhouettes: &silhouettes, grid: Grid::around(middle, longest + BORDER_CELLS * cell, cell) };
    let parts = octree.parts(options.tolerated);
    let mut mesh = surface::surface(&octree, &parts);
    let removed_parts = mesh.remove_small_parts(options.least_part);
    if mesh.triangles.is_empty() {
        return Err(bounds::nothing().into());
    }
    mesh.add_normals();
    drop((parts, silhouettes));
    if options.colours {
        mesh.colours = colours_of(&mesh, cell, (cameras, &used), pictures, control)?;
    }
    let scale = options.mm_per_unit.unwrap_or(1.0);
    mesh.scale(scale);
    let [low, high] = mesh.bounds().unwrap_or_default();
    let summary = HullSummary {
        is_mm: options.mm_per_unit.is_some(),
        volume: mesh.volume(),
        area: mesh.area(),
        size: [0, 1, 2].map(|axis| f64::from(high[axis] - low[axis])),
        cell: cell * scale,
        vertices: mesh.positions.len(),
        triangles: mesh.triangles.len(),
        removed_parts,
        empty_views,
        contradicting_views,
    };
    Ok(Hull { mesh, summary })
}

fn check(cameras: &[PinholeCamera], options: &HullOptions) -> Result<(), Error> {
    let wrong =
        |field: &str, detail: String| Err(Error::new(ErrorKind::InvalidParameter, detail).in_field(field, None));
    if let Some(cells) = options.resolution.filter(|cells| !(16..=MAX_RESOLUTION).contains(cells)) {
        return wrong("resolution", format!("resolution is {cells}; choose 16 to {MAX_RESOLUTION} cells"));
    }
    if options.tolerated > surface::MAX_TOLERATED {
        let most = surface::MAX_TOLERATED;
        return wrong("tolerated", format!("tolerated is {}; choose 0 to {most} views", options.tolerated));
    }
    if options.mm_per_unit.is_some_and(|mm| !(mm.is_finite() && mm > 0.0)) {
        return wrong("mm_per_unit", "mm_per_unit must be a number greater than 0".to_owned());
    }
    if cameras.len() > MAX_VIEWS {
        return wrong("views", format!("{} views; a hull is made from at most {MAX_VIEWS}", cameras.len()));
    }
    Ok(())
}

/// Removes the views whose mask contradicts the others, and returns their indices.
fn leave_out(silhouettes: &mut Numbered) -> Result<Vec<usize>, Error> {
    let (views, found): (Vec<usize>, Vec<Silhouette>) = silhouettes.drain(..).unzip();
    let bad = consistency::bad_views(&found)?;
    let left_out = views.iter().zip(&bad).filter(|(_, bad)| **bad).map(|(view, _)| *view).collect();
    let all = views.into_iter().zip(found).zip(bad);
    silhouettes.extend(all.filter(|(_, bad)| !bad).map(|(silhouette, _)| silhouette));
    Ok(left_out)
}

/// The silhouettes of the views with an object, with their indices, and the indices of the others.
fn silhouettes(
    cameras: &[PinholeCamera],
    pictures: &dyn ViewPictures,
    resolution: usize,
    control: &dyn Control,
) -> Result<(Numbered, Vec<usize>), Interrupted> {
    let longest = (PIXELS_PER_CELL * resolution as f64) as usize;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let read = |(view, camera): (usize, &PinholeCamera)| -> Result<Option<Silhouette>, Interrupted> {
        control.check()?;
        let mask = pictures.mask(view)?;
        same_size("mask", view, [mask.width, mask.height], camera)?;
        let silhouette = Silhouette::of(camera, &mask, longest);
        let done = 1 + done.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        control.progress("silhouettes", done, cameras.len());
        Ok(silhouette)
    };
    let all: Vec<Option<Silhouette>> = cameras.par_iter().enumerate().map(read).collect::<Result<_, _>>()?;
    let empty = all.iter().enumerate().filter(|(_, found)| found.is_none()).map(|(view, _)| view).collect();
    let found: Numbered = all.into_iter().enumerate().filter_map(|(view, found)| Some((view, found?))).collect();
    if found.len() < LEAST_VIEWS {
        let detail = format!(
            "{} of {} views have a mask with an object; a hull needs {LEAST_VIEWS} views or more from different directions",
            found.len(),
            cameras.len()
        );
        return Err(Error::new(ErrorKind::InvalidPoses, detail).into());
    }
    Ok((found, empty))
}

/// Width of a pixel of the picture at a point, in the unit of the world.
fn pixel_size(silhouette: &Silhouette, point: [f64; 3]) -> f64 {
    let camera = &silhouette.camera;
    let depth = camera.project(point).map_or(f64::INFINITY, |(_, depth)| depth);
    depth / (camera.focal_px[0] * silhouette.reduction as f64)
}

fn colours_of(
    mesh: &Mesh,
    cell: f64,
    (cameras, used): (&[PinholeCamera], &[usize]),
    pictures: &dyn ViewPictures,
    control: &dyn Control,
) -> Result<Vec<[u8; 3]>, Interrupted> {
    let mut colouring = Colouring::new(mesh, cell);
    let mut has_picture = false;
    for (done, &view) in used.iter().enumerate() {
        let camera = &cameras[view];
        control.check()?;
        if let Some(picture) = pictures.picture(view)? {
            same_size("picture", view, [picture.width, picture.height], camera)?;
            colouring.add(mesh, camera, &picture);
            has_picture = true;
        }
        control.progress("colours", done + 1, used.len());
    }
    Ok(if has_picture { colouring.finish(mesh) } else { Vec::new() })
}

fn same_size(what: &str, view: usize, [width, height]: [usize; 2], camera: &PinholeCamera) -> Result<(), Error> {
    let [expected_width, expected_height] = camera.size;
    if [width, height] == camera.size && width > 0 && height > 0 {
        return Ok(());
    }
    let detail = format!(
        "the {what} of view {} has {width} x {height} px, its camera {expected_width} x {expected_height} px; they must \
         be of the same picture",
        view + 1
    );
    Err(Error::new(ErrorKind::SizeMismatch, detail))
}
