//! `pinstack gc`: the clean-up that a server does every hour, now.

use std::time::Duration;

use clap::Args;

use super::store::Place;
use crate::store::{
    Expiry, MetadataStore,
    gc::{GRACE, collect},
};

/// Remove what is over its time and files that no row names, now; a server does the same every hour. Also while a server runs.
#[derive(Debug, Args)]
pub struct Gc {
    #[command(flatten)]
    place: Place,
    /// Leave files alone that are younger, seconds: an upload lies on the disk before its row does. 0 only while no server runs
    #[arg(long, value_name = "SECONDS", default_value_t = GRACE.as_secs())]
    grace_s: u64,
    /// Confirm that the clock is right, after it jumped or after no server ran for more than a day: what has expired by this
    /// clock is then removed
    #[arg(long)]
    clock_is_right: bool,
}

impl Gc {
    /// Does it.
    ///
    /// # Errors
    /// When rows or files cannot be read or removed.
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let store = self.place.open().await?;
            if self.clock_is_right {
                store.rows.confirm_clock().await?;
            }
            let collected = collect(&store.rows, &store.blobs, Duration::from_secs(self.grace_s), &store.config.retention()).await?;
            store.rows.close().await;
            println!(
                "removed: {} jobs over their time, {} zips of jobs over theirs, {} uploads that nobody went on with, files of \
                 {} jobs that no row names",
                collected.expired, collected.uploads, collected.given_up, collected.orphans
            );
            Ok(())
        })
    }
}
