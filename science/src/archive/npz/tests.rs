//! Numpy files: valid ones as numpy writes them, and invalid ones.

use proptest::prelude::*;

use super::*;

/// A `.npy` file with this header, byte for byte.
fn npy_of(header: &str, data: &[u8]) -> Vec<u8> {
    let padding = 63 - (10 + header.len()) % 64;
    let header = format!("{header}{}\n", " ".repeat(padding));
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.bytes());
    out.extend(data);
    out
}

fn header(descr: &str, fortran: bool, shape: &str) -> String {
    let order = if fortran { "True" } else { "False" };
    format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
}

/// Element of row `r`, column `c` of slice `n` in the arrays of these tests.
fn element(n: usize, r: usize, c: usize) -> f64 {
    (n * 9 + r * 3 + c) as f64 / 8.0
}

fn expected() -> Vec<[f64; 9]> {
    (0..4).map(|n| std::array::from_fn(|i| element(n, i / 3, i % 3))).collect()
}

/// The numbers of 4 x 3 x 3 in the order in which they lie in the file.
fn numbers(fortran: bool) -> Vec<f64> {
    let in_c = expected().concat();
    match fortran {
        false => in_c,
        true => (0..36).map(|i| (i % 4, i / 4)).map(|(n, rest)| element(n, rest % 3, rest / 3)).collect(),
    }
}

fn told(bytes: Vec<u8>, wanted: Option<&str>) -> String {
    let fault = matrices(bytes, wanted).expect_err("the test gives something wrong");
    assert_eq!(fault.kind, ErrorKind::InvalidProfile, "{fault}");
    fault.detail
}

fn eight(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn every_size_order_and_end_of_numbers_is_read() {
    for fortran in [false, true] {
        let values = numbers(fortran);
        let four = values.iter().map(|&v| v as f32);
        let files = [
            ("<f8", eight(&values)),
            (">f8", values.iter().flat_map(|v| v.to_be_bytes()).collect()),
            ("<f4", four.clone().flat_map(f32::to_le_bytes).collect()),
            (">f4", four.flat_map(f32::to_be_bytes).collect()),
        ];
        for (descr, data) in files {
            let file = npy_of(&header(descr, fortran, "(4, 3, 3)"), &data);
            assert_eq!(matrices(file, None), Ok(expected()), "{descr}, fortran {fortran}");
        }
    }
}

#[test]
fn nine_numbers_a_row_are_read_in_both_orders() {
    let file = npy_of(&header("<f8", false, "(4, 9)"), &eight(&expected().concat()));
    assert_eq!(matrices(file, None), Ok(expected()));
    let by_columns: Vec<f64> = (0..36).map(|i| expected()[i % 4][i / 4]).collect();
    let file = npy_of(&header("<f8", true, "(4, 9)"), &eight(&by_columns));
    assert_eq!(matrices(file, None), Ok(expected()));
}

#[test]
fn the_later_versions_of_the_format_and_python_2_are_read() {
    let text = "{'shape': (4L, 3L, 3L), \"descr\": \"<f8\", 'fortran_order': False}\n";
    for version in [2, 3] {
        let mut file = b"\x93NUMPY".to_vec();
        file.extend([version, 0]);
        file.extend((text.len() as u32).to_le_bytes());
        file.extend(text.bytes());
        file.extend(eight(&numbers(false)));
        assert_eq!(matrices(file, None), Ok(expected()), "version {version}");
    }
}

#[test]
fn what_is_written_is_what_numpy_writes() {
    let mut by_numpy = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (4, 3, 3), }".to_vec();
    by_numpy.resize(127, b' ');
    by_numpy.push(b'\n');
    by_numpy.extend(eight(&numbers(false)));
    assert_eq!(npy::of_floats(&[4, 3, 3], numbers(false)), by_numpy);
    assert!(npy::of_integers(&[2], [640, 480]).windows(7).any(|w| w == b"(2,), }"));
    assert!(npy::of_integers(&[], [7]).windows(5).any(|w| w == b"(), }"));
    assert_eq!(matrices(by_numpy, None), Ok(expected()));
}

#[test]
fn objects_and_other_numbers_and_shapes_are_refused_with_what_to_do() {
    let objects = npy_of(&header("|O", false, "(4,)"), b"\x80\x04cposix\nsystem\n.");
    assert!(
        told(objects, None)
            .contains("holds Python objects (dtype '|O'), which may hold anything and are never unpacked")
    );
    let long = npy_of(&header(&"O".repeat(9_000), false, "(4,)"), b"");
    assert!(told(long, None).contains(&format!("(dtype '{}'), which", "O".repeat(80))));
    let whole = npy_of(&header("<i8", false, "(4, 3, 3)"), &[0; 288]);
    assert!(told(whole, None).contains("dtype '<i8'; save them as float64: h.astype(float)"));
    let affine = npy_of(&header("<f8", false, "(4, 2, 3)"), &[0; 192]);
    assert_eq!(
        told(affine, None),
        "the file has the shape (4, 2, 3) instead of N x 3 x 3 or N x 9, one matrix per slice"
    );
    assert!(told(npy_of(&header("<f8", false, "(9,)"), &[0; 72]), None).contains("the shape (9,)"));
    let record = npy_of("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (4,), }", &[0; 32]);
    assert!(told(record, None).contains("is not one of an array of plain numbers"));
    assert!(told(b"GIF89a".to_vec(), None).contains("neither an array (.npy) nor arrays in a zip (.npz)"));
}

#[test]
fn sizes_that_lie_are_refused_and_never_allocated() {
    for shape in ["(999999999999, 3, 3)", "(18446744073709551615, 9)", "(1001, 3, 3)"] {
        let file = npy_of(&header("<f8", false, shape), &[0; 72]);
        assert!(told(file, None).contains("at most 1000 slices: save the matrices of one stack only"), "{shape}");
    }
    let file = npy_of(&header("<f8", false, "(99999999999999999999, 3, 3)"), &[]);
    assert!(told(file, None).contains("is not one of an array of plain numbers"));
    let short = npy_of(&header("<f8", false, "(4, 3, 3)"), &[0; 287]);
    assert_eq!(
        told(short, None),
        "the file has 287 bytes of numbers, but its shape (4, 3, 3) needs 288; was it cut off?"
    );
    let long = npy_of(&header("<f8", false, "(4, 3, 3)"), &[0; 289]);
    assert!(told(long, None).ends_with("needs 288; it is not a single array"));
    let mut endless = b"\x93NUMPY\x02\x00".to_vec();
    endless.extend(u32::MAX.to_le_bytes());
    assert!(told(endless, None).contains("the header of the file has 4294967295 bytes"));
    assert!(told(b"\x93NUMPY\x09\x00".to_vec(), None).contains("of version 9.0"));
}

fn zipped(arrays: &[(&'static str, Vec<u8>)]) -> Vec<u8> {
    packed(arrays.iter().cloned()).expect("names differ")
}

#[test]
fn of_several_arrays_the_one_with_the_matrices_is_taken() {
    let stack = || npy::of_floats(&[4, 3, 3], numbers(false));
    let other = || npy::of_floats(&[4, 9], vec![1.0; 36]);
    let list = || npy::of_floats(&[4], vec![1.0; 4]);
    let named = zipped(&[("other", other()), ("homographies", stack()), ("gains", list())]);
    assert_eq!(matrices(named.clone(), None), Ok(expected()));
    assert_eq!(matrices(named.clone(), Some("other")), Ok(vec![[1.0; 9]; 4]));
    assert_eq!(told(named, Some("h")), "the file has no array 'h'; it holds other, homographies, gains");
    assert_eq!(matrices(zipped(&[("gains", list()), ("arr_0", stack())]), None), Ok(expected()));
    let unclear = zipped(&[("a", stack()), ("b", other())]);
    assert!(
        told(unclear, None)
            .starts_with("several arrays of the file could be the matrices: a, b; name one with ?array=")
    );
    assert!(
        told(zipped(&[("gains", list())]), None).contains("no array of matrices (N x 3 x 3 or N x 9); it holds gains")
    );
    assert!(told(zipped(&[]), None).contains("it holds no arrays"));
    assert!(told(stack(), Some("a")).contains("none to choose by 'array'"));
}

#[test]
fn a_torn_zip_is_an_invalid_profile() {
    let whole = zipped(&[("homographies", npy::of_floats(&[4, 3, 3], numbers(false)))]);
    for cut in 2..whole.len() {
        told(whole[..cut].to_vec(), None);
    }
    let large = zipped(&[("homographies", vec![0; (1 << 20) + 1])]);
    assert!(told(large, None).contains("at most 1048576 are allowed"));
}

proptest! {
    #[test]
    fn damaged_files_never_panic(flips in prop::collection::vec((0..100_000usize, 1..=255u8), 1..6), in_zip: bool) {
        let mut bytes = npy::of_floats(&[4, 3, 3], numbers(false));
        if in_zip {
            bytes = zipped(&[("homographies", bytes)]);
        }
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        let _ = matrices(bytes, None);
    }

    #[test]
    fn any_header_is_read_or_refused(text in "[{}()',: 0-9a-z<>TF|]{0,60}") {
        let _ = matrices(npy_of(&text, &[0; 72]), None);
    }
}
