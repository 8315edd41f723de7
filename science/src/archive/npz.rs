//! Reads matrices from a zip of numpy arrays (`.npz`), and writes such files.

use std::io;

use super::{
    container::{Container, pack},
    limits::ArchiveLimits,
    members::Member,
    messages::listed,
    npy,
};
use crate::types::{Error, ErrorKind};

/// Default name of the array of matrices.
pub const HOMOGRAPHIES: &str = "homographies";

/// Maximum number of members: each is opened to read its shape.
const MAX_ARRAYS: usize = 200;

/// Maximum size of the array, bytes. 1000 matrices have 72 kB.
const MAX_ARRAY_BYTES: u64 = 1 << 20;

/// The matrices of a numpy file. The first bytes decide between `.npy` and `.npz`. Of an `.npz` this is the array
/// `wanted` if given, else `homographies` if present, else the only array of shape N x 3 x 3 or N x 9.
///
/// # Errors
/// [`ErrorKind::InvalidProfile`] when the file is malformed, or when the choice of the array is ambiguous; the message
/// lists the arrays.
pub fn matrices(bytes: Vec<u8>, wanted: Option<&str>) -> Result<Vec<[f64; 9]>, Error> {
    if bytes.starts_with(npy::MAGIC) {
        return match wanted {
            Some(_) => Err(npy::wrong(
                "the body is one array (.npy), so there is none to choose by 'array'; omit that parameter".into(),
            )),
            None => npy::matrices(&bytes, "the file"),
        };
    }
    if !bytes.starts_with(b"PK") {
        let detail =
            "the body is neither an array (.npy) nor arrays in a zip (.npz); write it with numpy.save or numpy.savez";
        return Err(npy::wrong(detail.into()));
    }
    from_zip(bytes, wanted).map_err(|fault| match fault.kind {
        ErrorKind::Internal | ErrorKind::ResourcesExhausted => fault,
        // to the caller every other defect of the zip is a profile that cannot be read
        _ => Error { kind: ErrorKind::InvalidProfile, ..fault },
    })
}

fn from_zip(bytes: Vec<u8>, wanted: Option<&str>) -> Result<Vec<[f64; 9]>, Error> {
    let limits =
        ArchiveLimits { max_members: MAX_ARRAYS, max_member_bytes: MAX_ARRAY_BYTES, ..ArchiveLimits::default() };
    let container = Container::in_memory(bytes, &limits)?;
    let arrays: Vec<(String, Member)> = container
        .members()?
        .into_iter()
        .filter_map(|member| Some((member.name.strip_suffix(".npy")?.to_owned(), member)))
        .collect();
    let found = |name: &str| arrays.iter().find(|(array, _)| array == name);
    let all = || match arrays.as_slice() {
        [] => "it holds no arrays".to_owned(),
        arrays => format!("it holds {}", listed(arrays.iter().map(|(name, _)| name.as_str()))),
    };
    let (name, member) = match wanted {
        Some(name) => found(name).ok_or_else(|| {
            let name: String = name.chars().take(80).collect();
            npy::wrong(format!("the file has no array '{name}'; {}", all()))
        })?,
        None => match found(HOMOGRAPHIES) {
            Some(array) => array,
            None => {
                let mut fitting = Vec::new();
                for array in &arrays {
                    let start = container.read_start(&array.1, &limits, npy::START_BYTES)?;
                    if npy::layout(&start, &array.0).is_ok_and(|layout| layout.is_of_matrices()) {
                        fitting.push(array);
                    }
                }
                match fitting.as_slice() {
                    [only] => *only,
                    [] => {
                        let all = all();
                        let detail = format!("the file has no array of matrices (N x 3 x 3 or N x 9); {all}");
                        return Err(npy::wrong(detail));
                    }
                    several => {
                        let names = listed(several.iter().map(|(name, _)| name.as_str()));
                        return Err(npy::wrong(format!(
                            "several arrays of the file could be the matrices: {names}; name one with ?array=, or call it \
                             '{HOMOGRAPHIES}'"
                        )));
                    }
                }
            }
        },
    };
    npy::matrices(&container.read(member, &limits)?, &format!("the array '{name}'"))
}

/// Packs arrays (name, bytes of the `.npy` file) so that `numpy.load` can read them.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] for a duplicate name.
pub fn packed(arrays: impl IntoIterator<Item = (&'static str, Vec<u8>)>) -> io::Result<Vec<u8>> {
    let mut out = io::Cursor::new(Vec::new());
    pack(&mut out, arrays.into_iter().map(|(name, bytes)| (format!("{name}.npy"), bytes)))?;
    Ok(out.into_inner())
}

#[cfg(test)]
mod tests;
