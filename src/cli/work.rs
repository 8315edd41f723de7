//! `pinstack work`: workers without the API, on a store that other processes share.

use std::sync::Arc;

use anyhow::{Context, bail};

use super::{
    files, logging,
    serve::{ENDED_BY_SIGNAL, GRACE, StopSignals},
    store::make_files_private,
};
use crate::{
    disk_budget::DiskBudget,
    jobs::ScienceRunner,
    settings::{Flags, Settings},
    store::{self, backup::remove_mark, folder},
    telemetry::traces,
    worker::{Deps, Pool, maintenance},
};

/// Runs until SIGTERM or SIGINT; a second signal ends the process at once.
///
/// # Errors
/// When the configuration is invalid, or the store cannot be used.
pub fn run(flags: Flags) -> anyhow::Result<()> {
    let config = Settings::load(&flags)?;
    if config.workers == 0 {
        bail!("workers must be at least 1 here: this process runs jobs and nothing else");
    }
    logging::start(&config.log, config.log_format)?;
    make_files_private();
    files::raise_limit();
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut signals = StopSignals::listen()?;
        let traces = config.collector().map(traces::start).transpose()?;
        let data_dir = &config.data_dir;
        folder::make(data_dir).with_context(|| format!("data_dir: cannot create the folder {}", data_dir.display()))?;
        remove_mark(data_dir).with_context(|| format!("data_dir: cannot write into {}", data_dir.display()))?;
        let store = store::open_shared(data_dir, &config.shared()?).await?;
        let (disk, runner) = (DiskBudget::new(&store, config.min_free_bytes), Arc::new(ScienceRunner::default()));
        let pool = Pool::start(Deps { store: store.clone(), disk, runner }, config.worker());
        let maintenance = maintenance::start(store.clone(), maintenance::EVERY, config.retention());
        eprintln!("{} workers run jobs of {}", config.workers, data_dir.display());
        signals.next().await;
        tracing::info!("shutting down; a second signal ends the process at once");
        tokio::select! {
            () = pool.shutdown(GRACE) => {}
            () = signals.next() => {
                tracing::warn!("the process ends at once; another process resumes the jobs that were running");
                std::process::exit(ENDED_BY_SIGNAL)
            }
        }
        drop(maintenance);
        store.metadata.close().await;
        if let Some(traces) = traces {
            traces.stop().await;
        }
        Ok(())
    })
}
