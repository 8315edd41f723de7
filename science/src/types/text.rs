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

#[cfg(test)]
mod tests {
    use super::*;

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
