//! Jobs per second of several processes whose jobs are no work.

use std::{
    path::{Path, PathBuf},
    process::{Child, Command},
    sync::Arc,
    time::{Duration, Instant},
};

use pinstack::{
    contract::{
        JobError,
        outcome::{JobOutcome, StackOutcome},
        request::JobRequest,
    },
    disk_budget::DiskBudget,
    jobs::{JobContext, JobOutput, JobRunner, ProgressSink},
    store::{Enqueue, MetadataStore, Store, blobs::upload_key, conformance::stack_outcome},
    worker::{Config, Deps, Pool},
};

use crate::store::{job, open, put_profiles, schema};

const FOLDER: &str = "PINSTACK_BENCH_FOLDER";
const DATABASE: &str = "PINSTACK_BENCH_DATABASE";
/// Jobs that a process runs at a time.
const WORKERS: usize = 4;
/// Jobs per measurement.
const JOBS: usize = 3000;
/// Jobs that pass before the time is taken.
const WARM_UP: u64 = 500;

/// Prints the table.
pub async fn run() {
    println!("processes   jobs per second ({WORKERS} workers each, jobs without work)");
    for processes in [1, 2, 4] {
        let database = schema().await;
        let folder = tempfile::tempdir().expect("a folder");
        let store = open(folder.path(), Some(&database)).await;
        put_profiles(&*store.metadata).await;
        accept(&store).await;
        let mut children: Vec<Child> = (0..processes).map(|_| start(folder.path(), &database)).collect();
        let rate = rate(&*store.metadata).await;
        for child in &mut children {
            child.kill().and_then(|()| child.wait()).expect("a worker ends");
        }
        println!("{processes:>9}   {rate:.0}");
        store.metadata.close().await;
    }
}

/// Accepts all jobs, each with a zip of its own.
async fn accept(store: &Store) {
    for number in 0..JOBS {
        let mut new = job(number);
        let file = tempfile::NamedTempFile::new_in(store.workspace.path()).expect("a file");
        std::fs::write(file.path(), b"no zip").expect("written");
        let key = upload_key(new.id);
        store
            .blobs
            .put(&key, pinstack::store::SpoolFile::persistent(file.into_temp_path().keep().expect("kept")))
            .await
            .expect("a blob");
        if let JobRequest::Stack(request) = &mut new.request {
            request.upload.key = key;
        }
        let accepted = store.metadata.enqueue(&new, u64::MAX).await.expect("enqueue");
        assert!(matches!(accepted, Enqueue::Accepted(_)));
    }
}

/// Jobs per second between the end of the warm-up and that of the last job.
async fn rate(metadata: &dyn MetadataStore) -> f64 {
    let mut begun: Option<(Instant, u64)> = None;
    loop {
        let counts = metadata.counts().await.expect("counts");
        assert_eq!(counts.failed, 0, "a job failed");
        if begun.is_none() && counts.succeeded >= WARM_UP {
            begun = Some((Instant::now(), counts.succeeded));
        }
        if let Some((at, before)) = begun
            && counts.succeeded >= JOBS as u64
        {
            return (counts.succeeded - before) as f64 / at.elapsed().as_secs_f64();
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

fn start(folder: &Path, database: &str) -> Child {
    let program = std::env::current_exe().expect("this program");
    Command::new(program).env(FOLDER, folder).env(DATABASE, database).spawn().expect("a worker")
}

/// A process of workers, which this program starts itself as.
pub struct Worker {
    folder: PathBuf,
    database: String,
}

impl Worker {
    /// `Some` in such a process.
    pub fn of_environment() -> Option<Self> {
        let database = std::env::var(DATABASE).ok()?;
        Some(Self { folder: std::env::var_os(FOLDER)?.into(), database })
    }

    /// Runs jobs until the process is killed.
    pub async fn run(self) {
        let store = open(&self.folder, Some(&self.database)).await;
        let disk = DiskBudget::new(&store, 0);
        let config = Config { workers: WORKERS, ..Config::default() };
        let _pool = Pool::start(Deps { store, disk, runner: Arc::new(NoWork) }, config);
        std::future::pending().await
    }
}

struct NoWork;

impl JobRunner for NoWork {
    fn memory_need(&self, _request: &JobRequest) -> u64 {
        0
    }

    fn disk_need(&self, _request: &JobRequest) -> u64 {
        0
    }

    fn run(&self, _context: &JobContext, _sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
        let outcome = match stack_outcome() {
            JobOutcome::Stack(outcome) => JobOutcome::Stack(StackOutcome { artifacts: Vec::new(), ..outcome }),
            other => other,
        };
        Ok(JobOutput { outcome, warnings: Vec::new(), profile: None, files: Vec::new() })
    }
}
