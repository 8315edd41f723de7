//! `pinstack backup` and `pinstack restore`.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;

use super::{
    config::ServeConfig,
    store::{Place, open},
};
use crate::store::{
    self,
    backup::{Copied, copy, remove_mark},
    data_folder,
    verify::{Depth, Report, verify},
};

/// Back up the database and all files into a folder; a server may run meanwhile. Files that an earlier backup in the
/// folder has are not copied again. A backup is a data folder itself; uploads that are still arriving are not in it.
#[derive(Debug, Args)]
pub struct Backup {
    #[command(flatten)]
    place: Place,
    /// Folder of the backup: a new one, an empty one, or that of an earlier backup
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Restore a backup into a data folder, which must have no database yet; at the end, every file is compared with its
/// digest.
#[derive(Debug, Args)]
pub struct Restore {
    #[command(flatten)]
    place: Place,
    /// Folder of the backup
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
}

impl Backup {
    /// Runs the command.
    ///
    /// # Errors
    /// When a file is missing, or either side cannot be read or written. An earlier backup is still complete then.
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let config = self.place.config()?;
            refuse_postgres(&config)?;
            let (_, store) = open(config).await?;
            let copied = copy(&store, &self.to).await?;
            store.metadata.close().await;
            print(copied);
            Ok(())
        })
    }
}

impl Restore {
    /// Runs the command.
    ///
    /// # Errors
    /// When there is a database already, the backup cannot be read, or something in it is missing or has changed.
    pub fn run(self) -> anyhow::Result<()> {
        let config = self.place.config()?;
        refuse_postgres(&config)?;
        let to = config.data_dir;
        if data_folder::exists(&to) {
            bail!("{} has a database; specify a new folder with --data-dir, or move the old one away", to.display());
        }
        if !data_folder::exists(&self.from) {
            bail!("there is no database in {}; specify the folder of the backup with --from", self.from.display());
        }
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let backup = store::open(&self.from).await?;
            let copied = copy(&backup, &to).await.context("the backup could not be restored")?;
            backup.metadata.close().await;
            print(copied);
            let restored = store::open(&to).await?;
            remove_mark(&to)?;
            let report = verify(&restored, Depth::Digests).await?;
            restored.metadata.close().await;
            require_complete(&report)
        })
    }
}

/// These commands copy the database as a file.
fn refuse_postgres(config: &ServeConfig) -> anyhow::Result<()> {
    if config.database()?.is_some() {
        bail!(
            "the rows are in Postgres: back them up with pg_dump (or restore them with pg_restore) first, then copy the \
             folder {} with a snapshot of its file system or rsync; 'pinstack verify' compares both",
            config.data_dir.display()
        );
    }
    Ok(())
}

fn print(copied: Copied) {
    let Copied { jobs, files, bytes, kept, unreadable } = copied;
    println!("{jobs} jobs; {files} files copied ({bytes} bytes), {kept} were there already");
    if unreadable > 0 {
        println!("{unreadable} jobs cannot be read; they are copied unchanged, and 'pinstack verify' lists them");
    }
}

fn require_complete(report: &Report) -> anyhow::Result<()> {
    for line in report.faults.iter().chain(&report.unreadable) {
        println!("{line}");
    }
    if report.faults.is_empty() {
        return Ok(());
    }
    bail!(
        "{} faults: the files listed above are missing or changed in the backup; everything else is restored",
        report.faults.len()
    )
}
