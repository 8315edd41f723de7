//! Loads the settings: flags over `PINSTACK_*` environment variables over a TOML file over defaults. A bad value is
//! refused with the source that it comes from.

use anyhow::anyhow;
use figment::{
    Figment, Metadata, Source,
    providers::{Env, Format, Serialized, Toml},
};

use super::{
    environment::{self, PREFIX},
    table::{Flags, ROWS, Settings},
};

impl Settings {
    /// Merges the sources and checks the result.
    ///
    /// # Errors
    /// When a value has the wrong type or breaks its rule, or when the file or the environment has an unknown key. The
    /// error names the setting and the source.
    pub fn load(flags: &Flags) -> anyhow::Result<Self> {
        let keys: Vec<&str> = ROWS.iter().map(|row| row.key).collect();
        environment::check(std::env::vars_os().filter_map(|(name, _)| name.into_string().ok()), &keys)?;
        let mut figment = Figment::from(Serialized::defaults(Self::default()));
        let file = flags.config.clone().or_else(|| std::env::var_os("PINSTACK_CONFIG").map(Into::into));
        if let Some(file) = file {
            if !file.is_file() {
                return Err(anyhow!("there is no configuration file {}", file.display()));
            }
            if std::fs::read(&file).is_ok_and(|bytes| String::from_utf8(bytes).is_err()) {
                return Err(anyhow!("the configuration file {} is not in UTF-8; save it as UTF-8", file.display()));
            }
            figment = figment.merge(Toml::file_exact(file));
        }
        let figment = figment.merge(Env::prefixed(PREFIX).only(&keys)).merge(Serialized::globals(flags));
        let settings: Self = figment.extract().map_err(|error| {
            let key = error.path.join(".");
            let source = error.metadata.as_ref().map(|m| source(m, &key)).unwrap_or_default();
            let key = if key.is_empty() { key } else { format!("{key}: ") };
            anyhow!("{key}{}{source}", error.kind)
        })?;
        if let Some((key, rule)) = settings.violation() {
            let source = figment.find_metadata(key).map(|m| source(m, key)).unwrap_or_default();
            return Err(anyhow!("{key} {rule}{source}"));
        }
        Ok(settings)
    }
}

/// The source of a value, for the end of an error message.
fn source(metadata: &Metadata, key: &str) -> String {
    if metadata.name.contains("environment") {
        return format!(" (environment variable {PREFIX}{})", key.to_uppercase());
    }
    match &metadata.source {
        Some(Source::File(path)) if key.is_empty() => format!(" (file {})", path.display()),
        Some(Source::File(path)) => format!(" (file {}, key {key})", path.display()),
        _ => ROWS.iter().find(|row| row.key == key).map(|row| format!(" (flag --{})", row.flag())).unwrap_or_default(),
    }
}
