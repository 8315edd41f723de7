//! Meshes as files: binary PLY, and GLB (glTF 2.0 in one file).
//!
//! PLY has the coordinates of the world and colours as the pictures have them. GLB has them as well, under a node that
//! turns the z axis upwards to the y axis and converts mm to metres, as glTF wants; its colours are linear light.
//!
//! <https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html>

use std::io::{self, Write};

use serde_json::{Value, json};

use super::mesh::Mesh;

/// Codes of glTF.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
/// Bytes before the content of a GLB file, and before that of each of its two chunks.
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// Writes a mesh as binary little-endian PLY: `x y z` as floats, `red green blue` where the mesh has colours, faces.
///
/// # Errors
/// Those of `out`.
pub fn write_ply(mesh: &Mesh, mut out: impl Write) -> io::Result<()> {
    let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
    let colours = match mesh.colours.is_empty() {
        true => "",
        false => "property uchar red\nproperty uchar green\nproperty uchar blue\n",
    };
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty \
         float z\n{colours}element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for (at, position) in mesh.positions.iter().enumerate() {
        file.extend(position.iter().flat_map(|value| value.to_le_bytes()));
        file.extend(mesh.colours.get(at).into_iter().flatten());
    }
    for triangle in &mesh.triangles {
        file.push(3);
        file.extend(triangle.iter().flat_map(|corner| corner.to_le_bytes()));
    }
    out.write_all(&file)
}

/// Writes a mesh as GLB: positions, normals and, where the mesh has them, colours. `is_mm`: its unit is the mm;
/// otherwise its unit is kept as if it were the metre.
///
/// # Errors
/// Those of `out`; [`io::ErrorKind::InvalidInput`] for an empty mesh and for one larger than 4 GiB, which glTF cannot
/// hold.
pub fn write_glb(mesh: &Mesh, is_mm: bool, mut out: impl Write) -> io::Result<()> {
    let invalid = |what: &str| io::Error::new(io::ErrorKind::InvalidInput, what.to_owned());
    let [low, high] = mesh.bounds().ok_or_else(|| invalid("a GLB file cannot hold a mesh without vertices"))?;
    let mut parts = Parts::default();
    let vertices = mesh.positions.len();
    let floats = |values: &[[f32; 3]]| values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let positions = json!({ "componentType": FLOAT, "type": "VEC3", "count": vertices, "min": low, "max": high });
    let mut attributes = json!({
        "POSITION": parts.add(floats(&mesh.positions), VERTICES, positions),
        "NORMAL": parts.add(
            floats(&mesh.normals),
            VERTICES,
            json!({ "componentType": FLOAT, "type": "VEC3", "count": vertices })
        ),
    });
    if !mesh.colours.is_empty() {
        let linear: Vec<u16> = (0..=255).map(linear).collect();
        let rgba = |colour: &[u8; 3]| {
            [linear[colour[0] as usize], linear[colour[1] as usize], linear[colour[2] as usize], u16::MAX]
        };
        let bytes = mesh.colours.iter().flat_map(rgba).flat_map(u16::to_le_bytes).collect();
        let accessor =
            json!({ "componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC4", "count": vertices });
        attributes["COLOR_0"] = parts.add(bytes, VERTICES, accessor).into();
    }
    let corners = mesh.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect();
    let accessor = json!({ "componentType": UNSIGNED_INT, "type": "SCALAR", "count": 3 * mesh.triangles.len() });
    let indices = parts.add(corners, INDICES, accessor);
    let unit = if is_mm { 1e-3 } else { 1.0 };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let mut text = json!({
        "asset": { "version": "2.0", "generator": "pinstack" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "rotation": [-half, 0.0, 0.0, half], "scale": [unit, unit, unit] }],
        "meshes": [{ "primitives": [{ "attributes": attributes, "indices": indices, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 } }],
        "buffers": [{ "byteLength": parts.bytes.len() }],
        "bufferViews": parts.views,
        "accessors": parts.accessors,
    })
    .to_string();
    text.push_str(&" ".repeat(text.len().next_multiple_of(4) - text.len()));
    let length = HEADER + 2 * CHUNK_HEADER + text.len() + parts.bytes.len();
    let length = u32::try_from(length).map_err(|_| invalid("the mesh is larger than a GLB file can be, 4 GiB"))?;
    let word = |number: u32| number.to_le_bytes();
    out.write_all(&[*b"glTF", word(2), word(length), word(text.len() as u32), *b"JSON"].concat())?;
    out.write_all(text.as_bytes())?;
    out.write_all(&[word(parts.bytes.len() as u32), *b"BIN\0"].concat())?;
    out.write_all(&parts.bytes)
}

/// The binary content of a GLB file, and what describes it.
#[derive(Default)]
struct Parts {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Parts {
    /// Adds an array, whose length is a multiple of 4 bytes; returns the index of its accessor.
    fn add(&mut self, bytes: Vec<u8>, target: u32, mut accessor: Value) -> usize {
        let at = self.views.len();
        let view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": target });
        self.bytes.extend(bytes);
        self.views.push(view);
        accessor["bufferView"] = at.into();
        self.accessors.push(accessor);
        at
    }
}

/// Linear light of an sRGB value, of 65535 (IEC 61966-2-1).
fn linear(value: u32) -> u16 {
    let value = f64::from(value) / 255.0;
    let linear = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (65535.0 * linear).round() as u16
}
