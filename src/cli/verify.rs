//! `pinstack verify`: whether every file that the database refers to exists and is unchanged.

use anyhow::bail;
use clap::Args;

use super::{output::say, store::Place};
use crate::store::verify::{Depth, verify};

/// Verify that every file that the database refers to exists and is unchanged; the exit code is 0 if so. A server may
/// run meanwhile.
#[derive(Debug, Args)]
pub struct Verify {
    #[command(flatten)]
    place: Place,
    /// Compare sizes only, without reading the files
    #[arg(long)]
    quick: bool,
}

impl Verify {
    /// Runs the command.
    ///
    /// # Errors
    /// When something is missing or changed, or the data cannot be read.
    pub fn run(self) -> anyhow::Result<()> {
        let depth = if self.quick { Depth::Sizes } else { Depth::Digests };
        tokio::runtime::Runtime::new()?.block_on(async {
            let (_, store) = self.place.open().await?;
            let report = verify(&store, depth).await?;
            store.metadata.close().await;
            say(format!(
                "{} jobs, {} files ({} bytes), {} profile revisions, {} open uploads; files of {} unknown jobs",
                report.jobs, report.files, report.bytes, report.revisions, report.open_uploads, report.orphans
            ));
            for line in report.faults.iter().chain(&report.unreadable) {
                say(line);
            }
            if !report.unreadable.is_empty() {
                let (count, faults) = (report.unreadable.len(), report.faults.len());
                bail!(
                    "{count} rows cannot be read, and there are {faults} other faults; delete such a stack or profile (DELETE \
                     works), or run the version that wrote it"
                );
            }
            if !report.faults.is_empty() {
                bail!("{} faults; the files listed above are missing or changed", report.faults.len());
            }
            Ok(())
        })
    }
}
