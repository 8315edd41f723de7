//! Metashape: cameras exported as XML.
//!
//! `transform` of a camera leads from camera to chunk: four rows of four numbers, with the centre in the last column. A
//! camera without it was not aligned. The chunk, or the component that the camera belongs to, may have a transform with
//! `rotation`, `translation` and `scale` from chunk to world.

use std::collections::HashMap;

use nalgebra::{Matrix3, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::found::Found;
use crate::{
    photogrammetry::poses::{Pose, invalid},
    types::Error,
};

/// Most nodes of the document. A camera has about 20.
const MAX_NODES: u32 = 1_000_000;
/// Most attributes of an element. The parser compares each with all before it. Metashape writes about 10.
const MAX_ATTRIBUTES: usize = 64;
/// Most occurrences of `xmlns`. The parser copies all declarations in force for each element. Metashape writes none.
const MAX_NAMESPACES: usize = 64;

pub(super) fn read(text: &str, found: &mut Found) -> Result<(), Error> {
    refuse_costly(text)?;
    let options = ParsingOptions { allow_dtd: false, nodes_limit: MAX_NODES, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options)
        .map_err(|error| invalid(format!("the XML cannot be read: {error}")))?;
    // only where Metashape puts them: a search in all depths would cost the square of the size
    let root = document.root_element();
    let chunks = std::iter::once(root).chain(root.children()).filter(|node| node.has_tag_name("chunk"));
    let mut with_cameras = chunks.filter(|chunk| cameras(chunk).next().is_some());
    let Some(chunk) = with_cameras.next() else {
        let detail = "the XML has no chunk with cameras; export the cameras of Metashape as XML (File, Export, Export \
                      Cameras)";
        return Err(invalid(detail));
    };
    if with_cameras.next().is_some() {
        return Err(invalid("the XML has several chunks with cameras; export one chunk"));
    }
    let mut components: HashMap<&str, World> = HashMap::new();
    for component in children(chunk, "components").flat_map(|list| children(list, "component")) {
        if let (Some(id), Some(world)) = (component.attribute("id"), World::of(&component)?) {
            components.insert(id, world);
        }
    }
    let of_chunk = World::of(&chunk)?.unwrap_or_default();
    for sensor in children(chunk, "sensors").flat_map(|list| children(list, "sensor")) {
        found.camera(sensor.attribute("id").unwrap_or_default(), focal_px(sensor).unwrap_or_default());
    }
    for camera in cameras(&chunk) {
        // finding a line reads the text up to it, so only for an error
        let place = || format!("line {}", camera.document().text_pos_at(camera.range().start).row);
        let name = camera.attribute("label").unwrap_or_default().to_owned();
        let Some(transform) = child(&camera, "transform") else {
            found.unregistered(name, place)?;
            continue;
        };
        let values: [f64; 16] = numbers(&transform)?;
        let row = |at: usize| [values[at], values[at + 1], values[at + 2]];
        let from_camera = Matrix3::from_fn(|i, j| row(4 * i)[j]);
        let centre = Vector3::new(values[3], values[7], values[11]);
        let world = camera.attribute("component_id").and_then(|id| components.get(id)).unwrap_or(&of_chunk);
        let rotation = (world.rotation * from_camera).transpose();
        let centre = world.scale * (world.rotation * centre) + world.translation;
        let rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| rotation[(i, j)]));
        let pose = Pose { name, centre: centre.into(), rotation: Some(rotation), commanded_deg: None };
        found.pose(pose, camera.attribute("sensor_id").unwrap_or_default(), place)?;
    }
    Ok(())
}

/// The focal length of a sensor, px: the adjusted one, if it has one; one per axis in old versions.
fn focal_px(sensor: Node<'_, '_>) -> Option<f64> {
    let calibrations = children(sensor, "calibration");
    let calibration = calibrations.max_by_key(|node| node.attribute("class") == Some("adjusted"))?;
    let value = |name: &str| Some(numbers::<1>(&child(&calibration, name)?).ok()?[0]);
    value("f").or_else(|| Some((value("fx")? + value("fy")?) / 2.0))
}

/// Refuses what costs the parser the square of its size.
///
/// XML has no `<` within a tag, so each tag begins at one, and the tags of elements are counted exactly. What looks
/// like a tag in a comment is counted as well.
fn refuse_costly(text: &str) -> Result<(), Error> {
    let refused = |at: usize, what: String| {
        let line = 1 + text.as_bytes()[..at].iter().filter(|byte| **byte == b'\n').count();
        let detail = format!(
            "line {line}: {what}, which Metashape does not write; export the cameras again (File, Export, Export \
             Cameras)"
        );
        Err(invalid(detail))
    };
    if let Some((at, _)) = text.match_indices("xmlns").nth(MAX_NAMESPACES) {
        return refused(at, format!("the XML has more than {MAX_NAMESPACES} namespaces"));
    }
    // within a tag: the quote that is open, if one is, and the number of attributes
    let mut tag: Option<(Option<u8>, usize)> = None;
    for (at, byte) in text.bytes().enumerate() {
        match (byte, &mut tag) {
            (b'<', _) => tag = Some((None, 0)),
            (_, None) => {}
            (b'>', Some((None, _))) => tag = None,
            (b'"' | b'\'', Some((quote @ None, count))) => {
                *quote = Some(byte);
                *count += 1;
                if *count > MAX_ATTRIBUTES {
                    return refused(at, format!("an element has more than {MAX_ATTRIBUTES} attributes"));
                }
            }
            (_, Some((quote, _))) if *quote == Some(byte) => *quote = None,
            (_, Some(_)) => {}
        }
    }
    Ok(())
}

/// The cameras of a chunk: children of `cameras`, or of a group in it.
fn cameras<'a, 'input: 'a>(chunk: &Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    children(*chunk, "cameras").flat_map(|list| {
        let grouped = children(list, "group").flat_map(|group| children(group, "camera"));
        children(list, "camera").chain(grouped)
    })
}

fn children<'a, 'input: 'a>(node: Node<'a, 'input>, name: &'static str) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

/// A similarity transform from chunk to world.
struct World {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    scale: f64,
}

impl Default for World {
    fn default() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros(), scale: 1.0 }
    }
}

impl World {
    /// The transform that is a child of `node`. Parts that are absent are those of the identity.
    fn of(node: &Node<'_, '_>) -> Result<Option<Self>, Error> {
        let Some(transform) = child(node, "transform") else { return Ok(None) };
        let mut world = Self::default();
        if let Some(rotation) = child(&transform, "rotation") {
            let values: [f64; 9] = numbers(&rotation)?;
            world.rotation = Matrix3::from_row_slice(&values);
        }
        if let Some(translation) = child(&transform, "translation") {
            world.translation = numbers::<3>(&translation)?.into();
        }
        if let Some(scale) = child(&transform, "scale") {
            [world.scale] = numbers(&scale)?;
        }
        Ok(Some(world))
    }
}

fn child<'a, 'input>(node: &Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.has_tag_name(name))
}

/// The numbers that an element contains.
fn numbers<const N: usize>(node: &Node<'_, '_>) -> Result<[f64; N], Error> {
    let words = node.text().unwrap_or_default().split_ascii_whitespace().take(N + 1);
    let numbers: Result<Vec<f64>, _> = words.map(str::parse).collect();
    numbers.ok().and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        let line = node.document().text_pos_at(node.range().start).row;
        invalid(format!("line {line}: the element '{}' does not have {N} numbers", node.tag_name().name()))
    })
}
