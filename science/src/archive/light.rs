//! Recognises the light of a folder by its name.

/// The direction of the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Light {
    /// From the front: the picture.
    Front,
    /// From behind: the silhouette.
    Back,
}

/// Folder names of front-light slices, one line per language: English, German, French, Spanish, Italian, Dutch.
const FRONT: [&str; 6] = [
    "front frontlight frontlit fg foreground withoutbacklight",
    "vorne vordergrund vorderlicht frontlicht auflicht beleuchtet ohnegegenlicht",
    "avant devant lumiereavant eclairageavant sanscontrejour",
    "frente frontal delante luzfrontal sincontraluz",
    "fronte frontale davanti lucefrontale senzacontroluce",
    "voor voorkant voorgrond voorlicht opvallendlicht zondertegenlicht",
];

/// Folder names of back-light slices, in the same languages.
const BACK: [&str; 6] = [
    "back backlight backlit bg background withbacklight",
    "hinten hintergrund hintergrundlicht gegenlicht durchlicht rucklicht ruecklicht mitgegenlicht",
    "arriere derriere fond contrejour aveccontrejour lumierearriere eclairagearriere retroeclairage",
    "contraluz concontraluz fondo detras trasera luztrasera retroiluminacion",
    "controluce concontroluce dietro retro sfondo retroilluminazione",
    "achter achterkant achtergrond achterlicht tegenlicht doorvallendlicht",
];

impl Light {
    /// The light that a folder stands for, by its name. `None` for other names.
    ///
    /// | light | English names | other languages (German, French, Spanish, Italian, Dutch) |
    /// |---|---|---|
    /// | front | `front`, `frontlight`, `frontlit`, `fg`, `without_backlight` | `auflicht`, `avant`, ... |
    /// | back | `back`, `backlight`, `backlit`, `bg`, `with_backlight` | `gegenlicht`, `contre-jour`, ... |
    ///
    /// Case, accents, blanks, `_` and `-` are ignored.
    pub fn of_folder(name: &str) -> Option<Self> {
        let plain = plain(name);
        let is_in = |names: &[&str]| names.iter().any(|line| line.split(' ').any(|name| name == plain));
        match (is_in(&FRONT), is_in(&BACK)) {
            (true, _) => Some(Self::Front),
            (_, true) => Some(Self::Back),
            _ => None,
        }
    }

    /// The adjective in messages.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Front => "front-light",
            Self::Back => "back-light",
        }
    }
}

/// A name in lower case, without separators and accents.
pub(super) fn plain(name: &str) -> String {
    name.chars()
        .flat_map(char::to_lowercase)
        // macOS stores accents as combining characters
        .filter(|c| !matches!(c, ' ' | '_' | '-' | '\u{300}'..='\u{36F}'))
        .map(|c| match c {
            'à' | 'á' | 'â' | 'ä' => 'a',
            'è' | 'é' | 'ê' | 'ë' => 'e',
            'ì' | 'í' | 'î' | 'ï' => 'i',
            'ò' | 'ó' | 'ô' | 'ö' => 'o',
            'ù' | 'ú' | 'û' | 'ü' => 'u',
            other => other,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_understood_in_several_languages() {
        for name in ["front", "Front_Light", "beleuchtet", "Auflicht", "avant", "Éclairage avant", "frontale", "voor"]
        {
            assert_eq!(Light::of_folder(name), Some(Light::Front), "{name}");
        }
        let decomposed = "arrie\u{300}re";
        for name in
            ["back", "with-backlight", "Gegenlicht", "Rücklicht", "arrière", decomposed, "Contre-jour", "contraluz"]
        {
            assert_eq!(Light::of_folder(name), Some(Light::Back), "{name}");
        }
        for name in ["", "y=020", "left", "frontback", "slices"] {
            assert_eq!(Light::of_folder(name), None, "{name}");
        }
    }

    #[test]
    fn no_word_stands_for_both_lights_and_each_is_in_normal_form() {
        let words = |lines: [&'static str; 6]| lines.iter().flat_map(|line| line.split(' ')).collect::<Vec<_>>();
        let (front, back) = (words(FRONT), words(BACK));
        for word in front.iter().chain(&back) {
            assert_eq!(plain(word), *word);
            assert!(!(front.contains(word) && back.contains(word)), "{word}");
        }
    }
}
