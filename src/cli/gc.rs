//! `pinstack gc`: the garbage collection that a server runs every hour.

use std::time::Duration;

use clap::Args;

use super::{output::say, store::Place};
use crate::store::gc::{GRACE, collect};

/// Remove expired stacks and uploads, and files that belong to no stack, now instead of at the next hour. A server may
/// run meanwhile.
#[derive(Debug, Args)]
pub struct Gc {
    #[command(flatten)]
    place: Place,
    /// Keep files that are younger than this, seconds: they may belong to a stack that is just being accepted. Use 0
    /// only while no server runs
    #[arg(long, value_name = "SECONDS", default_value_t = GRACE.as_secs())]
    grace_s: u64,
    /// Confirm that the clock of this machine is right. Needed after the clock has jumped, or after no server ran for
    /// more than a day: until then nothing that has expired is removed
    #[arg(long)]
    clock_is_right: bool,
}

impl Gc {
    /// Runs the command.
    ///
    /// # Errors
    /// When metadata or files cannot be read or removed.
    pub fn run(self) -> anyhow::Result<()> {
        tokio::runtime::Runtime::new()?.block_on(async {
            let (config, store) = self.place.open().await?;
            if self.clock_is_right {
                store.metadata.confirm_clock().await?;
            }
            let removed = collect(&store, Duration::from_secs(self.grace_s), &config.retention()).await?;
            store.metadata.close().await;
            say(format!(
                "removed: {} expired jobs, {} expired zips of jobs, {} expired uploads, files of {} unknown jobs",
                removed.expired, removed.uploads, removed.given_up, removed.orphans
            ));
            Ok(())
        })
    }
}
