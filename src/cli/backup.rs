//! `pinstack backup` and `pinstack restore`.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use super::{
    output::say,
    store::{Place, open},
};
use crate::{
    settings::Settings,
    store::{
        self, DatabaseUrl,
        backup::{Copied, copy, copy_files, remove_mark},
        data_folder,
        verify::{Depth, Report, verify},
    },
};

/// Back up the database and all files into a folder, while a server may run. Files of an earlier backup in the folder
/// are not copied again. The backup is a data folder on which a server can run, even if the original is in Postgres and
/// S3. Uploads that are still arriving are not in it.
#[derive(Debug, Args)]
pub struct Backup {
    #[command(flatten)]
    place: Place,
    /// Folder of the backup: a new one, an empty one, or that of an earlier backup
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Restore a backup, or move a data folder, into a new data folder or an empty Postgres database. At the end every file
/// is compared with its digest. If it is interrupted while it copies, run it again; if while it compares, everything is
/// restored, and 'pinstack verify' compares again.
#[derive(Debug, Args)]
pub struct Restore {
    #[command(flatten)]
    place: Place,
    /// Folder of the backup, or a data folder to move. A server that runs on it must be stopped, except with
    /// --files-only
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// Copy only the files, while a server still runs on the folder: a later restore without this option then has less
    /// to copy, and the server is stopped for a shorter time. Only into Postgres
    #[arg(long)]
    files_only: bool,
}

impl Backup {
    /// Runs the command.
    ///
    /// # Errors
    /// When a file is missing, or either side cannot be read or written. An earlier backup is still complete then.
    pub fn run(self) -> anyhow::Result<()> {
        tokio::runtime::Runtime::new()?.block_on(async {
            let (_, store) = open(self.place.settings()?).await?;
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
        let config = self.place.settings()?;
        if !data_folder::exists(&self.from) {
            bail!("there is no database in {}; specify the folder of the backup with --from", self.from.display());
        }
        tokio::runtime::Runtime::new()?.block_on(async {
            match config.database()? {
                None if self.files_only => bail!("--files-only needs database_url; without it, restore in one go"),
                None => into_folder(&self.from, &config.data_dir).await,
                Some(database) => into_database(&self.from, config, &database, self.files_only).await,
            }
        })
    }
}

async fn into_folder(from: &Path, to: &Path) -> anyhow::Result<()> {
    if data_folder::exists(to) {
        bail!("{} has a database; specify a new folder with --data-dir, or move the old one away", to.display());
    }
    let backup = store::open(from).await?;
    let copied = copy(&backup, to).await.context("the backup could not be restored")?;
    backup.metadata.close().await;
    print(copied);
    let restored = store::open(to).await?;
    remove_mark(to)?;
    let report = verify(&restored, Depth::Digests).await?;
    restored.metadata.close().await;
    require_complete(&report)
}

/// Files first, then all rows at once: until then the service has no stack that lacks a file.
async fn into_database(from: &Path, config: Settings, database: &DatabaseUrl, files_only: bool) -> anyhow::Result<()> {
    data_folder::require_empty(database).await?;
    let backup = store::open(from).await?;
    let (_, to) = open(config).await?;
    let rows = to.workspace.new_path("rows")?;
    let copied = copy_files(&backup, &*to.blobs, &to.workspace, &rows).await;
    let copied = copied.context("the files could not be copied; run the command again to continue")?;
    backup.metadata.close().await;
    print(copied);
    if files_only {
        to.metadata.close().await;
        data_folder::remove_file(&rows)?;
        say(format!("the files are copied; stop the server of {}, then restore without --files-only", from.display()));
        return Ok(());
    }
    let filled = data_folder::fill_database(database, &rows).await;
    let removed = data_folder::remove_file(&rows);
    filled?;
    removed?;
    let report = verify(&to, Depth::Digests).await?;
    to.metadata.close().await;
    require_complete(&report)
}

fn print(copied: Copied) {
    let Copied { jobs, files, bytes, kept, unreadable } = copied;
    say(format!("{jobs} jobs; {files} files copied ({bytes} bytes), {kept} were there already"));
    if unreadable > 0 {
        say(format!("{unreadable} jobs cannot be read; they are copied unchanged, and 'pinstack verify' lists them"));
    }
}

fn require_complete(report: &Report) -> anyhow::Result<()> {
    for line in report.faults.iter().chain(&report.unreadable) {
        say(line);
    }
    if report.faults.is_empty() {
        return Ok(());
    }
    bail!(
        "{} faults: the files listed above are missing or changed in the backup; everything else is restored",
        report.faults.len()
    )
}
