//! Loads the configuration: flags over `PINSTACK_*` environment variables over a TOML file over defaults. A bad value
//! is refused with the source that it comes from. The settings themselves are in [`super::settings`].

use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use figment::{
    Figment, Metadata, Source,
    providers::{Env, Format, Serialized, Toml},
};

pub use super::settings::{DEFAULT_LISTEN, Flags, ServeConfig};
use super::{
    environment::{self, PREFIX},
    settings::{KEYS, flag},
};
use crate::{
    store::{DatabaseUrl, Retention, S3Location, Shared},
    telemetry::traces::Collector,
};

impl ServeConfig {
    /// Merges the sources and checks the result.
    ///
    /// # Errors
    /// When a value has the wrong type or breaks its rule, or when the file or the environment has an unknown key. The
    /// error names the setting and the source.
    pub fn load(flags: &Flags) -> anyhow::Result<Self> {
        environment::check(std::env::vars_os().filter_map(|(name, _)| name.into_string().ok()), KEYS)?;
        let mut figment = Figment::from(Serialized::defaults(Self::default()));
        let file = flags.config.clone().or_else(|| std::env::var_os("PINSTACK_CONFIG").map(Into::into));
        if let Some(file) = file {
            if !file.is_file() {
                return Err(anyhow!("there is no configuration file {}", file.display()));
            }
            figment = figment.merge(Toml::file_exact(file));
        }
        let figment = figment.merge(Env::prefixed(PREFIX).only(KEYS)).merge(Serialized::globals(flags));
        let config: Self = figment.extract().map_err(|error| {
            let key = error.path.join(".");
            let source = error.metadata.as_ref().map(|m| source(m, &key)).unwrap_or_default();
            let key = if key.is_empty() { key } else { format!("{key}: ") };
            anyhow!("{key}{}{source}", error.kind)
        })?;
        if let Some((key, rule)) = config.violation() {
            let source = figment.find_metadata(key).map(|m| source(m, key)).unwrap_or_default();
            return Err(anyhow!("{key} {rule}{source}"));
        }
        Ok(config)
    }

    /// The database of `database_url` or `database_url_file`; `None`: SQLite in the data folder.
    ///
    /// # Errors
    /// When the file cannot be read, or contains no URL of Postgres.
    pub fn database(&self) -> anyhow::Result<Option<DatabaseUrl>> {
        let Some(file) = &self.database_url_file else { return Ok(self.database_url.clone()) };
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("database_url_file: cannot read {}", file.display()))?;
        let url = DatabaseUrl::new(text.trim());
        if !url.is_valid() {
            let file = file.display();
            bail!("database_url_file: {file} must contain a URL of Postgres: postgres://user:password@host/pinstack");
        }
        Ok(Some(url))
    }

    /// Where database and files are, as far as they are not in the data folder.
    ///
    /// # Errors
    /// As [`ServeConfig::database`].
    pub fn shared(&self) -> anyhow::Result<Shared> {
        Ok(Shared { database: self.database()?, storage: self.storage() })
    }

    /// The bucket of `storage_url`; `None`: files in the data folder.
    pub fn storage(&self) -> Option<S3Location> {
        Some(S3Location {
            url: self.storage_url.clone()?,
            endpoint: self.storage_endpoint.clone(),
            region: self.storage_region.clone(),
            ca_file: self.storage_ca_file.clone(),
            credentials_file: self.storage_credentials_file.clone(),
        })
    }

    /// The collector of `otlp_endpoint`, if there is one.
    pub fn collector(&self) -> Option<Collector<'_>> {
        let endpoint = self.otlp_endpoint.as_deref()?;
        Some(Collector { endpoint, ca_file: self.otlp_ca_file.as_deref() })
    }

    /// How long finished jobs are kept.
    pub fn retention(&self) -> Retention {
        let days = |days: Option<u32>| days.map(|days| Duration::from_secs(u64::from(days) * 24 * 60 * 60));
        Retention {
            stacks: days(self.keep_stacks_days),
            failed: days(self.keep_failed_days),
            uploads: days(self.keep_uploads_days),
        }
    }
}

/// The source of a value, for the end of an error message.
fn source(metadata: &Metadata, key: &str) -> String {
    if metadata.name.contains("environment") {
        return format!(" (environment variable {PREFIX}{})", key.to_uppercase());
    }
    match &metadata.source {
        Some(Source::File(path)) => format!(" (file {}, key {key})", path.display()),
        _ => format!(" (flag --{})", flag(key)),
    }
}
