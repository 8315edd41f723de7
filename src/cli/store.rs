//! The store, for commands that work on it beside a running server or without one.

use std::{
    fs,
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use clap::Args;
use rustix::{
    fs::{Access, Mode},
    io::Errno,
};

use crate::{
    settings::{Flags, Settings},
    store::{self, Store, backup::remove_mark, data_folder, folder},
};

/// The location of the data.
#[derive(Debug, Args)]
pub struct Place {
    /// Folder of the database and the files [default: pinstack-data] [env: PINSTACK_DATA_DIR]
    #[arg(long, value_name = "DIR", global = true)]
    data_dir: Option<PathBuf>,
    /// TOML file with the settings of the server [env: PINSTACK_CONFIG]
    #[arg(long, value_name = "FILE", global = true)]
    config: Option<PathBuf>,
}

/// Makes every file that this process creates private to its account: database, uploads, results, backups.
pub fn make_files_private() {
    rustix::process::umask(Mode::from_raw_mode(!folder::FILE & 0o077));
}

impl Place {
    /// The settings that a server would have.
    ///
    /// # Errors
    /// When they are invalid.
    pub fn settings(self) -> anyhow::Result<Settings> {
        make_files_private();
        Settings::load(&Flags { config: self.config, data_dir: self.data_dir, ..Flags::default() })
    }

    /// Opens an existing store: these commands do not create one where the name of a folder is mistyped. Returns the
    /// settings as well.
    ///
    /// # Errors
    /// When there is no store, or it cannot be used.
    pub async fn open(self) -> anyhow::Result<(Settings, Store)> {
        open(self.settings()?).await
    }
}

/// Opens the existing store of these settings. See [`Place::open`].
///
/// # Errors
/// When there is no store, or it cannot be used.
pub async fn open(config: Settings) -> anyhow::Result<(Settings, Store)> {
    let shared = config.shared()?;
    if shared.database.is_none() && !data_folder::exists(&config.data_dir) {
        bail!("there is no database in {}; specify the data folder with --data-dir", config.data_dir.display());
    }
    let store = store::open_shared(&config.data_dir, &shared).await?;
    Ok((config, store))
}

/// Refuses an existing folder in which the account of this process may not write, such as the volume of a container
/// that belongs to another user.
fn require_rights(folder: &Path) -> anyhow::Result<()> {
    let all = Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK;
    let (Ok(metadata), Err(Errno::ACCESS)) = (fs::metadata(folder), rustix::fs::access(folder, all)) else {
        return Ok(());
    };
    let (owner, mode, own) = (metadata.uid(), metadata.mode() & 0o777, rustix::process::getuid().as_raw());
    bail!(
        "data_dir: {} belongs to user {owner} with mode {mode:o}, and this process is user {own}, which may not write \
         there; give the folder to that user (chown {own}, on the machine that has it), or choose another folder",
        folder.display()
    )
}

/// Opens the store of a service and creates it where there is none. A backup becomes a store of its own.
///
/// # Errors
/// When the data folder cannot be made or written, or the store cannot be used.
pub async fn create(settings: &Settings) -> anyhow::Result<Store> {
    let data_dir = &settings.data_dir;
    require_rights(data_dir)?;
    folder::make(data_dir).with_context(|| format!("data_dir: cannot create the folder {}", data_dir.display()))?;
    remove_mark(data_dir).with_context(|| format!("data_dir: cannot write into {}", data_dir.display()))?;
    Ok(store::open_shared(data_dir, &settings.shared()?).await?)
}
