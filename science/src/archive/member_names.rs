//! Checks the names of members. They are labels for users and never opened as paths.

use super::messages::invalid;
use crate::types::Error;

/// Maximum length of a name, bytes.
const LONGEST: usize = 1_024;

/// Folders that systems, file servers and file managers put beside pictures, in lower case. Folders whose name begins
/// with a dot are skipped too. The page *Send* and the Python client have the same list.
pub(super) const SKIPPED_FOLDERS: [&str; 15] = [
    "__macosx",                  // macOS, in zips
    "@eadir",                    // Synology: thumbnails
    "#recycle",                  // Synology
    "#snapshot",                 // Synology
    "@recycle",                  // QNAP
    "@recently-snapshot",        // QNAP
    "@__thumb",                  // QNAP: thumbnails
    "@transcode",                // QNAP
    "@tmp",                      // Synology
    "$recycle.bin",              // Windows
    "recycler",                  // Windows, older
    "system volume information", // Windows
    "lost+found",                // Linux
    "network trash folder",      // AppleShare
    "temporary items",           // AppleShare
];

/// A name that is refused.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct InvalidName {
    /// The name as messages show it: its start, without control characters.
    pub shown: String,
    /// Why it is refused.
    pub reason: Reason,
}

/// Why a name is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reason {
    ControlCharacters,
    TooLong,
    Absolute,
    Outside,
    Empty,
}

impl Reason {
    /// A clause that follows the name.
    pub(super) fn clause(self) -> String {
        match self {
            Self::ControlCharacters => "contains control characters".to_owned(),
            Self::TooLong => format!("is longer than {LONGEST} bytes"),
            Self::Absolute => "is an absolute path".to_owned(),
            Self::Outside => "points outside of the zip (\"..\")".to_owned(),
            Self::Empty => "is empty".to_owned(),
        }
    }
}

/// The [`label`] of a member of a zip.
///
/// # Errors
/// [`ErrorKind::InvalidArchive`](crate::types::ErrorKind) for control characters, absolute names, `..`, and names that
/// are empty or too long.
pub(super) fn checked(raw: &str) -> Result<Option<String>, Error> {
    label(raw).map_err(|InvalidName { shown, reason }| {
        let clause = reason.clause();
        let detail = match reason {
            Reason::ControlCharacters => format!("the name {shown:?} {clause}; rename the file"),
            Reason::TooLong => format!("the name {shown}... {clause}; rename the file"),
            Reason::Absolute | Reason::Outside => {
                format!("{shown} {clause}; make the zip from within the folder of the stack")
            }
            Reason::Empty => format!("a member of the zip has no name ({shown:?}); make the zip again"),
        };
        invalid(&shown, detail)
    })
}

/// The name with `/` between folders and without empty parts; `None` for folders and for files that operating systems
/// add. Backslashes are separators: Windows programs write them, and file names do not contain them.
///
/// # Errors
/// For control characters, absolute names, `..`, and names that are empty or too long.
pub(super) fn label(raw: &str) -> Result<Option<String>, InvalidName> {
    let refused = |reason| {
        let shown = raw.chars().take(120).map(|c| if c.is_control() { '?' } else { c }).collect();
        Err(InvalidName { shown, reason })
    };
    // macOS stores the icon of a folder under this name
    let printed = raw.strip_suffix("Icon\r").unwrap_or(raw);
    if printed.chars().any(char::is_control) {
        return refused(Reason::ControlCharacters);
    }
    if raw.len() > LONGEST {
        return refused(Reason::TooLong);
    }
    let name = raw.replace('\\', "/");
    let drive = matches!(name.as_bytes(), [letter, b':', ..] if letter.is_ascii_alphabetic());
    if name.starts_with('/') || drive {
        return refused(Reason::Absolute);
    }
    let parts: Vec<&str> = name.split('/').filter(|part| !part.is_empty() && *part != ".").collect();
    if parts.contains(&"..") {
        return refused(Reason::Outside);
    }
    if name.ends_with('/') || is_system_file(&parts) {
        return Ok(None);
    }
    match parts.is_empty() {
        true => refused(Reason::Empty),
        false => Ok(Some(parts.join("/"))),
    }
}

/// True for bytes that are neither UTF-8 nor letters of code page 437, the default of zip. Windows programs write names
/// in the local code page (GBK, 932, 1252), which the zip does not specify.
pub(super) fn is_of_another_code_page(raw: &[u8]) -> bool {
    // the letters in the upper half of 437; the rest is box drawing, Greek and mathematics
    let is_letter = |byte: u8| matches!(byte, 0..=0xA8 | 0xE1);
    std::str::from_utf8(raw).is_err() && !raw.iter().copied().all(is_letter)
}

/// True for files that operating systems add to folders.
fn is_system_file(parts: &[&str]) -> bool {
    let Some((last, folders)) = parts.split_last() else { return false };
    let known = [".ds_store", "thumbs.db", "ehthumbs.db", "desktop.ini", "icon\r"];
    let is_skipped =
        |folder: &str| folder.starts_with('.') || SKIPPED_FOLDERS.contains(&folder.to_lowercase().as_str());
    folders.iter().any(|folder| is_skipped(folder))
        || last.starts_with("._")
        || known.contains(&last.to_ascii_lowercase().as_str())
}

/// The last component of a name.
pub(super) fn base(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

/// A name without its extension.
pub(super) fn stem(name: &str) -> &str {
    match name.rfind('.') {
        Some(dot) if dot > name.rfind('/').map_or(0, |slash| slash + 1) => &name[..dot],
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_labels_with_slashes() {
        for (raw, name) in [
            ("front\\img_1.jpg", "front/img_1.jpg"),
            ("./front//img_1.jpg", "front/img_1.jpg"),
            ("Käfer/vorne/1.tif", "Käfer/vorne/1.tif"),
        ] {
            assert_eq!(checked(raw).unwrap().as_deref(), Some(name));
        }
    }

    #[test]
    fn names_that_reach_outside_are_refused() {
        for raw in ["../a.jpg", "front/../../a.jpg", "..\\a.jpg", "/etc/passwd", "\\a.jpg", "C:\\a.jpg", "c:a.jpg"] {
            assert_eq!(checked(raw).unwrap_err().kind, crate::types::ErrorKind::InvalidArchive, "{raw}");
        }
        for raw in ["a\0.jpg", "a\n.jpg", "", "./"] {
            assert!(checked(raw).is_err() || checked(raw) == Ok(None), "{raw:?}");
        }
        assert!(checked("a\0.jpg").is_err());
        assert!(checked("front/..jpg").is_ok(), "dots in a name are fine");
    }

    #[test]
    fn system_files_and_folders_are_ignored() {
        for raw in [
            "front/",
            "front\\",
            "__MACOSX/front/._a.jpg",
            "front/._a.jpg",
            ".DS_Store",
            "x/Thumbs.db",
            "Desktop.ini",
            "front/Icon\r",
            "front/@eaDir/1.png/SYNOFILE_THUMB_M.png",
            "@eadir/1.png",
            "front/.@__thumb/default1.png",
            "#recycle/1.png",
            "a\\@Recycle\\1.png",
            "front/.thumbnails/1.png",
            "$RECYCLE.BIN/S-1-5/1.png",
            ".Trashes/501/1.png",
        ] {
            assert_eq!(checked(raw), Ok(None), "{raw}");
        }
    }

    #[test]
    fn folders_and_files_with_similar_names_are_kept() {
        for raw in ["thumbnails/1.png", "eaDir/1.png", "a@b/1.png", "#3/1.png", "recycle/1.png", "front/.1.png"] {
            assert_eq!(checked(raw).unwrap().as_deref(), Some(raw));
        }
    }

    #[test]
    fn the_stem_is_the_name_without_its_extension() {
        assert_eq!(
            [stem("a.b/c"), stem("a/c.d.jpg"), stem("a/.hidden"), stem("x.tif")],
            ["a.b/c", "a/c.d", "a/.hidden", "x"]
        );
        assert_eq!(base("a/b.jpg"), "b.jpg");
    }
}
