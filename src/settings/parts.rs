//! What the parts of the service take from the settings.

use std::time::Duration;

use anyhow::{Context, bail};

use super::table::Settings;
use crate::{
    jobs::reconstruction::{Colmap, find},
    store::{DatabaseUrl, Retention, S3Location, Shared},
    telemetry::traces::Collector,
    worker,
};

impl Settings {
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
    /// As [`Settings::database`].
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

    /// COLMAP and its limits; `None` when it is not there.
    pub fn colmap(&self) -> Option<Colmap> {
        Some(Colmap {
            program: find(self.colmap.as_deref())?,
            mesh_command: self.mesh_command.clone(),
            most_time: Duration::from_secs(60 * self.reconstruction_minutes),
            most_memory: self.memory_mb << 20,
        })
    }

    /// The workers of a process.
    pub fn worker(&self) -> worker::Config {
        let lease = Duration::from_secs(self.lease_s);
        worker::Config {
            workers: self.workers,
            memory_budget: self.memory_mb << 20,
            lease,
            beat: lease / worker::BEATS_PER_LEASE,
            ..worker::Config::default()
        }
    }
}
