//! `pinstack work`: workers without the API, on a store that other processes share.

use std::sync::Arc;

use anyhow::bail;

use super::{
    files, logging, memory,
    process::{GRACE, StopSignals},
    store::{create, make_files_private},
};
use crate::{
    disk_budget::DiskBudget,
    jobs::ScienceRunner,
    settings::{Flags, Settings},
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
    tokio::runtime::Runtime::new()?.block_on(async {
        let signals = StopSignals::listen()?;
        let traces = config.collector().map(traces::start).transpose()?;
        let store = create(&config).await?;
        let worker = memory::within(config.worker());
        let runner = ScienceRunner { memory: worker.memory_limit, colmap: config.colmap(), ..ScienceRunner::default() };
        let runner = Arc::new(runner);
        let disk = DiskBudget::new(&store, config.min_free_bytes);
        let pool = Pool::start(Deps { store: store.clone(), disk, runner }, worker);
        let maintenance = maintenance::start(store.clone(), maintenance::EVERY, config.retention());
        let (workers, folder) = (config.workers, config.data_dir.display());
        logging::announce(config.log_format, &format!("{workers} workers run jobs of {folder}"));
        signals.end_by(pool.shutdown(GRACE)).await;
        drop(maintenance);
        store.metadata.close().await;
        if let Some(traces) = traces {
            traces.stop().await;
        }
        Ok(())
    })
}
