//! `pinstack verify`: whether everything that the database names is there and unchanged.

use anyhow::bail;
use clap::Args;

use super::store::Place;
use crate::store::{
    MetadataStore,
    verify::{Depth, verify},
};

/// Look whether everything that the database names is there and unchanged; the exit code tells. Also while a server runs.
#[derive(Debug, Args)]
pub struct Verify {
    #[command(flatten)]
    place: Place,
    /// Compare sizes only, do not read every byte
    #[arg(long)]
    quick: bool,
}

impl Verify {
    /// Does it.
    ///
    /// # Errors
    /// When something is missing or changed, or the data cannot be read.
    pub fn run(self) -> anyhow::Result<()> {
        let depth = if self.quick { Depth::Sizes } else { Depth::Digests };
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let store = self.place.open().await?;
            let report = verify(&store.rows, &store.blobs, depth).await?;
            store.rows.close().await;
            println!(
                "{} jobs, {} files ({} bytes), {} profile revisions, {} open uploads; {} jobs' files that no row names",
                report.jobs, report.files, report.bytes, report.revisions, report.open_uploads, report.orphans
            );
            for line in report.faults.iter().chain(&report.unreadable) {
                println!("{line}");
            }
            if !report.unreadable.is_empty() {
                let (count, faults) = (report.unreadable.len(), report.faults.len());
                bail!(
                    "{count} rows cannot be read, and {faults} other faults; delete such a stack or profile (DELETE works), or \
                     run the version that wrote it"
                );
            }
            if !report.faults.is_empty() {
                bail!("{} faults; what is listed above is lost or changed", report.faults.len());
            }
            Ok(())
        })
    }
}
