//! The form in which texts that people write are compared.
//!
//! A letter with an accent has two forms in Unicode: one character (NFC: Windows, Linux, keyboards) or a letter and a
//! combining mark (NFD: macOS, in the names of files). Both look the same and are the same name. Names are compared in
//! NFC, and shown and stored as they were sent.

use unicode_normalization::{UnicodeNormalization, is_nfc};

/// The text in Unicode normal form C.
pub fn composed(text: &str) -> String {
    if is_nfc(text) { text.to_owned() } else { text.nfc().collect() }
}

/// The name in the form in which names of files and folders are compared: NFC, in lower case.
pub fn folded(name: &str) -> String {
    composed(&composed(name).to_lowercase())
}

/// The stem of a file name that Windows can write: `_con` for `con`, which is the name of a device with any extension.
pub fn not_a_device(stem: &str) -> String {
    let word = stem.split('.').next().unwrap_or_default().to_ascii_lowercase();
    let is_port = |rest: &str| matches!(rest.as_bytes(), [b'0'..=b'9']);
    let port = word.strip_prefix("com").or_else(|| word.strip_prefix("lpt"));
    let is_device = matches!(word.as_str(), "con" | "prn" | "aux" | "nul") || port.is_some_and(is_port);
    if is_device { format!("_{stem}") } else { stem.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_windows_devices_are_no_names_of_files() {
        for (stem, written) in [("CON", "_CON"), ("nul.txt", "_nul.txt"), ("Lpt1", "_Lpt1"), ("com0.a.b", "_com0.a.b")]
        {
            assert_eq!(not_a_device(stem), written);
        }
        for stem in ["conus", "com10", "com", "a.con", "_con", "auxiliary", ""] {
            assert_eq!(not_a_device(stem), stem);
        }
    }

    #[test]
    fn both_normal_forms_of_a_name_are_one_name() {
        for (one, other) in [
            ("Käfer", "Ka\u{308}fer"),
            ("KÄFER", "ka\u{308}fer"),
            ("각", "\u{1100}\u{1161}\u{11A8}"),
            ("が", "か\u{3099}"),
            ("Å", "\u{212B}"),
            ("e\u{323}\u{302}", "\u{1EC7}"),
        ] {
            assert_eq!(folded(one), folded(other), "{one}");
        }
        assert_ne!(folded("Kafer"), folded("Käfer"));
        assert_eq!(composed("Ka\u{308}fer"), "Käfer", "case is kept");
    }
}
