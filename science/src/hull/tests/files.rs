//! The files of a mesh, read again.

use serde_json::Value;

use super::super::{Mesh, write_glb, write_ply};

fn tetrahedron() -> Mesh {
    let mut mesh = Mesh {
        positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]],
        colours: vec![[255, 0, 0], [0, 128, 0], [0, 0, 255], [10, 20, 30]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        ..Mesh::default()
    };
    mesh.add_normals();
    mesh
}

fn float(bytes: &[u8]) -> f32 {
    f32::from_le_bytes(bytes[..4].try_into().expect("four bytes"))
}

fn word(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[..4].try_into().expect("four bytes")) as usize
}

#[test]
fn a_tetrahedron_has_its_volume_and_area() {
    let mesh = tetrahedron();
    assert!((mesh.volume() - 4.0).abs() < 1e-6);
    let slanted = 0.5 * (144.0_f64 + 64.0 + 36.0).sqrt();
    assert!((mesh.area() - (3.0 + 4.0 + 6.0 + slanted)).abs() < 1e-6);
    assert_eq!(mesh.bounds(), Some([[0.0; 3], [2.0, 3.0, 4.0]]));
}

#[test]
fn small_parts_are_removed() {
    let mut mesh = tetrahedron();
    let small = tetrahedron();
    mesh.positions.extend(small.positions.iter().map(|position| position.map(|value| 0.01 * value - 5.0)));
    mesh.triangles.extend(small.triangles.iter().map(|triangle| triangle.map(|at| at + 4)));
    assert_eq!(mesh.clone().remove_small_parts(1e-7), 0);
    assert_eq!(mesh.remove_small_parts(1e-5), 1);
    assert_eq!((mesh.positions, mesh.triangles), (small.positions, small.triangles));
}

#[test]
fn the_ply_file_has_positions_colours_and_faces() {
    let mut file = Vec::new();
    write_ply(&tetrahedron(), &mut file).expect("written");
    let end = file.windows(11).position(|window| window == b"end_header\n").expect("a header") + 11;
    let header = str::from_utf8(&file[..end]).expect("text");
    assert!(header.contains("element vertex 4\n") && header.contains("property uchar green\n"), "{header}");
    let body = &file[end..];
    assert_eq!(body.len(), 4 * 15 + 4 * 13);
    assert_eq!((float(&body[15..]), &body[27..30]), (2.0, &[0, 128, 0][..]));
    assert_eq!((body[60], word(&body[61..]), word(&body[65..])), (3, 0, 2));
}

#[test]
fn the_glb_file_has_what_the_specification_wants() {
    let mut file = Vec::new();
    write_glb(&tetrahedron(), true, &mut file).expect("written");
    assert_eq!((&file[..4], word(&file[4..]), word(&file[8..])), (&b"glTF"[..], 2, file.len()));
    let text = word(&file[12..]);
    assert_eq!((text % 4, &file[16..20]), (0, &b"JSON"[..]));
    let gltf: Value = serde_json::from_slice(&file[20..20 + text]).expect("JSON");
    let (header, bytes) = file[20 + text..].split_at(8);
    assert_eq!((word(header), &header[4..]), (bytes.len(), &b"BIN\0"[..]));
    assert_eq!(gltf["buffers"][0]["byteLength"], bytes.len());
    let attributes = &gltf["meshes"][0]["primitives"][0]["attributes"];
    let array = |accessor: &Value| {
        let view = &gltf["bufferViews"][accessor.as_u64().expect("an index") as usize];
        let [at, length] = ["byteOffset", "byteLength"].map(|name| view[name].as_u64().expect("a number") as usize);
        &bytes[at..at + length]
    };
    assert_eq!(float(&array(&attributes["POSITION"])[12..]), 2.0);
    assert_eq!(gltf["accessors"][0]["max"][2], 4.0);
    // half of sRGB is 21.6 % of the light
    let green = &array(&attributes["COLOR_0"])[10..12];
    assert_eq!((array(&attributes["COLOR_0"]).len(), u16::from_le_bytes([green[0], green[1]])), (32, 14146));
    assert_eq!(word(&array(&gltf["meshes"][0]["primitives"][0]["indices"])[4..]), 2);
    let refused = write_glb(&Mesh::default(), true, &mut Vec::new()).expect_err("nothing to write");
    assert_eq!(refused.kind(), std::io::ErrorKind::InvalidInput);
}
