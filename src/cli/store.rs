//! The data folder, for the commands that work on it beside a server or without one.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use rustix::fs::Mode;

use super::config::{Flags, ServeConfig};
use crate::store::{backup::DATABASE, blobs::local::LocalBlobs, folder, sqlite::SqliteMetadata};

/// Where the data is.
#[derive(Debug, Args)]
pub struct Place {
    /// Folder of the database and the files [default: pinstack-data] [env: PINSTACK_DATA_DIR]
    #[arg(long, value_name = "DIR")]
    data_dir: Option<PathBuf>,
    /// TOML file with the settings of the server [env: PINSTACK_CONFIG]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// From here on, what this process makes is for its own account alone: database, uploads, results, copies.
pub fn make_files_private() {
    rustix::process::umask(Mode::from_raw_mode(!folder::FILE & 0o077));
}

/// An open data folder.
pub struct Store {
    /// The settings that a server on it would have.
    pub config: ServeConfig,
    /// The rows.
    pub rows: SqliteMetadata,
    /// The blobs.
    pub blobs: LocalBlobs,
}

impl Place {
    /// The settings that a server would have.
    ///
    /// # Errors
    /// When they are bad.
    pub fn config(self) -> anyhow::Result<ServeConfig> {
        make_files_private();
        ServeConfig::load(&Flags { config: self.config, data_dir: self.data_dir, ..Flags::default() })
    }

    /// Opens the folder, which must hold a database: these commands make no new one where somebody mistyped a name.
    ///
    /// # Errors
    /// When there is none, or it cannot be used.
    pub async fn open(self) -> anyhow::Result<Store> {
        let config = self.config()?;
        let database = config.data_dir.join(DATABASE);
        if !database.is_file() {
            bail!("there is no {}; say with --data-dir where the data is", database.display());
        }
        let rows = SqliteMetadata::open(&database).await?;
        let blobs = LocalBlobs::open(&config.data_dir)?;
        Ok(Store { config, rows, blobs })
    }
}
