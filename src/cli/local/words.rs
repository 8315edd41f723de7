//! The sentences about zips that are sent to a service, for a person who has a folder.

use std::path::Path;

/// What is said otherwise, in this order.
const OTHERWISE: [(&str, &str); 16] = [
    ("; was the upload cut off? Make the zip again and send it again", "; copy it from the camera again"),
    ("; correct the zip and send it again", "; correct it"),
    (", one stack per zip", ", one stack per folder"),
    ("one zip holds", "one folder holds"),
    ("then send the stack again", "then try again"),
    ("and send the stack again", "and try again"),
    ("and send the zip again", "and try again"),
    ("; send the zip again", "; copy it from the camera again"),
    ("send the target again", "try again"),
    ("the disk of the service", "the disk"),
    ("the service has no disk space left", "there is no disk space left"),
    ("the service could not", "pinstack could not"),
    ("send fewer", "take fewer"),
    ("send all slices of the stack once", "the folder needs all slices of the stack, each once"),
    ("the archive", "the folder"),
    ("the zip", "the folder"),
];

/// A sentence about what is at `path`, which begins with it. Of a folder no zip is mentioned.
pub(in crate::cli) fn about(path: &Path, is_folder: bool, detail: &str) -> String {
    let mut told = detail.to_owned();
    if is_folder {
        for (zip, folder) in OTHERWISE {
            told = told.replace(zip, folder);
        }
    }
    let shown = path.display().to_string();
    if told.contains(&shown) { told } else { format!("{shown}: {told}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_not_called_a_zip() {
        let about = |detail| about(Path::new("beetle"), true, detail);
        assert_eq!(
            about("the zip holds no JPEG, PNG or TIFF pictures"),
            "beetle: the folder holds no JPEG, PNG or TIFF pictures"
        );
        let damaged = "1.jpg is damaged in the zip (Invalid checksum); was the upload cut off? Make the zip again and send it again";
        assert_eq!(
            about(damaged),
            "beetle: 1.jpg is damaged in the folder (Invalid checksum); copy it from the camera again"
        );
        assert_eq!(about("cannot read beetle/1.jpg"), "cannot read beetle/1.jpg");
        assert_eq!(super::about(Path::new("a.zip"), false, "the zip ends early"), "a.zip: the zip ends early");
    }
}
