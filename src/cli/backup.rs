//! `pinstack backup` and `pinstack restore`: a copy of everything, and the way back.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;

use super::store::Place;
use crate::store::{
    MetadataStore,
    backup::{Copied, DATABASE, copy, forget_copy},
    blobs::local::LocalBlobs,
    sqlite::SqliteMetadata,
    verify::{Depth, Report, verify},
};

/// Copy rows and files into a folder, also while a server runs. What the folder has already is not copied again. The
/// copy is a data folder itself; uploads that are still arriving are not in it.
#[derive(Debug, Args)]
pub struct Backup {
    #[command(flatten)]
    place: Place,
    /// Folder of the copy: a new one, an empty one, or that of the copy before
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Make a data folder of a copy. The data folder must have no database yet; every file is compared with its digest at the end.
#[derive(Debug, Args)]
pub struct Restore {
    #[command(flatten)]
    place: Place,
    /// Folder of the copy
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
}

impl Backup {
    /// Does it.
    ///
    /// # Errors
    /// When a file is missing, or either side cannot be read or written. The copy before is still whole then.
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let store = self.place.open().await?;
            let copied = copy(&store.rows, &store.blobs, &self.to).await?;
            store.rows.close().await;
            tell(copied);
            Ok(())
        })
    }
}

impl Restore {
    /// Does it.
    ///
    /// # Errors
    /// When there is a database already, the copy cannot be read, or something in it is missing or has changed.
    pub fn run(self) -> anyhow::Result<()> {
        let to = self.place.config()?.data_dir;
        if to.join(DATABASE).exists() {
            bail!("{} has a database; name a new folder with --data-dir, or move the old one away", to.display());
        }
        let database = self.from.join(DATABASE);
        if !database.is_file() {
            bail!("there is no {}; say with --from where the copy is", database.display());
        }
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let (rows, blobs) = (SqliteMetadata::open(&database).await?, LocalBlobs::open(&self.from)?);
            let copied = copy(&rows, &blobs, &to).await.context("the copy could not be restored")?;
            rows.close().await;
            tell(copied);
            let (rows, blobs) = (SqliteMetadata::open(to.join(DATABASE)).await?, LocalBlobs::open(&to)?);
            forget_copy(&to)?;
            let report = verify(&rows, &blobs, Depth::Digests).await?;
            rows.close().await;
            told_well(&report)
        })
    }
}

fn tell(copied: Copied) {
    let Copied { jobs, files, bytes, kept, unreadable } = copied;
    println!("{jobs} jobs; {files} files copied ({bytes} bytes), {kept} were there already");
    if unreadable > 0 {
        println!("{unreadable} jobs cannot be read; they are copied as they are, and 'pinstack verify' names them");
    }
}

fn told_well(report: &Report) -> anyhow::Result<()> {
    for line in report.faults.iter().chain(&report.unreadable) {
        println!("{line}");
    }
    if report.faults.is_empty() {
        return Ok(());
    }
    bail!("{} faults: what is listed above was lost or changed in the copy; the rest is restored", report.faults.len())
}
