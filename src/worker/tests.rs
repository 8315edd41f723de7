//! Workers on a real store with jobs that the test holds in its hand: they wait for a message, never for time.

use std::{
    path::{Path, PathBuf},
    sync::{
        Mutex,
        atomic::{AtomicU64, Ordering},
        mpsc,
    },
};

use sha2::{Digest, Sha256};
use tempfile::TempDir;
use tokio::sync::mpsc as async_mpsc;
use uuid::Uuid;

use super::*;
use crate::{
    archive::{self, ArchiveLimits},
    jobs::{Bench, Made, MadeFile, Science, Watcher, testkit},
    model::{
        Code, Fault, JobState, Progress, Stop,
        outcome::JobOutcome,
        request::{CalibrationRequest, JobRequest, StackLayout, StackRequest, Upload},
    },
    store::{
        Job, ManualClock, NewJob, StoreResult,
        blobs::{JobBlobs, Partial, Room, local::LocalBlobs, result_key, upload_key},
        conformance::{self, LEASE, accept},
        digest::hex,
        sqlite::SqliteRows,
    },
};

/// What a job in a test is told to do next.
enum Order {
    /// Report this fraction.
    Report(f64),
    /// Wait until it is not wanted any more, and stop.
    WaitForStop,
    Succeed,
    Fail,
    /// The disk became full under it.
    Full,
    Panic,
}

/// Work that says that it began and then does what it is ordered to.
struct Puppet {
    began: async_mpsc::UnboundedSender<Uuid>,
    orders: Mutex<mpsc::Receiver<Order>>,
    need: u64,
    disk_need: u64,
}

impl Work for Puppet {
    fn memory_need(&self, _request: &JobRequest) -> u64 {
        self.need
    }

    fn disk_need(&self, _request: &JobRequest) -> u64 {
        self.disk_need
    }

    fn run(&self, bench: &Bench, watcher: &dyn Watcher) -> Result<Made, Stop> {
        let _ = self.began.send(bench.job.id);
        loop {
            let order = self.orders.lock().unwrap().recv();
            match order {
                Ok(Order::Report(fraction)) => {
                    watcher.report(Progress { stage: "fusing".into(), completed: 1, total: 2, fraction });
                }
                Ok(Order::WaitForStop) => loop {
                    watcher.check()?;
                    std::thread::yield_now();
                },
                Ok(Order::Fail) => return Err(Fault::new(Code::InvalidImage, "torn").into()),
                Ok(Order::Full) => return Err(Fault::new(Code::InsufficientStorage, "full").into()),
                Ok(Order::Panic) => panic!("a bug, made for the test"),
                Ok(Order::Succeed) => return Ok(made(bench)),
                Err(_) => return Err(Fault::new(Code::Internal, "the test is over").into()),
            }
        }
    }
}

fn made(bench: &Bench) -> Made {
    let path = bench.scratch.join("image.png");
    std::fs::write(&path, std::fs::read(&bench.archive).unwrap()).unwrap();
    let key = result_key(bench.job.id, bench.job.lease_token, "image.png");
    let files = vec![MadeFile { path, key }];
    Made { outcome: conformance::stack_outcome(), warnings: vec![], profile: None, files }
}

/// A store, its clock, and the strings of the puppets.
struct Stage {
    folder: TempDir,
    clock: Arc<ManualClock>,
    deps: Deps,
    began: async_mpsc::UnboundedReceiver<Uuid>,
    orders: mpsc::Sender<Order>,
}

/// Beats often, so that what a beat must see is seen soon.
fn config(workers: usize) -> Config {
    let often = Duration::from_millis(5);
    Config { workers, lease: LEASE, beat: often, progress_gap: often, poll: often, ..Config::default() }
}

async fn stage_with_need(need: u64) -> Stage {
    stage_with_needs(need, 0).await
}

async fn stage_with_needs(need: u64, disk_need: u64) -> Stage {
    let folder = tempfile::tempdir().unwrap();
    let clock = Arc::new(ManualClock::default());
    let rows = SqliteRows::open_with_clock(folder.path().join("rows.db"), clock.clone()).await.unwrap();
    let blobs = LocalBlobs::open(folder.path()).unwrap();
    let (began_here, began) = async_mpsc::unbounded_channel();
    let (orders, to_puppet) = mpsc::channel();
    let work = Puppet { began: began_here, orders: Mutex::new(to_puppet), need, disk_need };
    let deps = Deps { rows: Arc::new(rows), blobs: Arc::new(blobs), work: Arc::new(work) };
    conformance::put(&*deps.rows, "rig", "lens", 1.5).await;
    Stage { folder, clock, deps, began, orders }
}

async fn stage() -> Stage {
    stage_with_need(1).await
}

impl Stage {
    async fn accept(&self) -> Uuid {
        let mut job: NewJob = conformance::stack();
        let key = upload_key(job.id);
        if let JobRequest::Stack(request) = &mut job.request {
            request.upload.key = key.clone();
        }
        let spooled = self.deps.blobs.spool_dir().join(job.id.to_string());
        std::fs::write(&spooled, "the archive").unwrap();
        self.deps.blobs.publish(&spooled, &key).await.unwrap();
        accept(&*self.deps.rows, &job).await.id
    }

    fn order(&self, order: Order) {
        self.orders.send(order).expect("the puppets listen");
    }

    /// Waits for the row to be as it should.
    async fn until(&self, id: Uuid, holds: impl Fn(&Job) -> bool) -> Job {
        let mut changes = self.deps.rows.changes();
        loop {
            let job = conformance::job(&*self.deps.rows, id).await;
            if holds(&job) {
                return job;
            }
            let _ = tokio::time::timeout(Duration::from_secs(1), changes.recv()).await;
        }
    }

    async fn ended(&self, id: Uuid) -> Job {
        self.until(id, |job| job.state.is_final()).await
    }

    async fn results_of(&self, job: &Job) -> Option<Vec<u8>> {
        let key = result_key(job.id, job.lease_token, "image.png");
        self.deps.blobs.local_path(&key).await.unwrap().map(|path| std::fs::read(path).unwrap())
    }

    /// The folders that running jobs have in the spool.
    fn benches(&self) -> usize {
        std::fs::read_dir(self.deps.blobs.spool_dir()).unwrap().count()
    }
}

macro_rules! worker_test {
    (async fn $name:ident() $body:block) => {
        #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $name() {
            let test = async $body;
            tokio::time::timeout(Duration::from_secs(60), test).await.expect("the test hangs");
        }
    };
}

worker_test! {
    async fn a_job_is_done_and_its_files_are_published() {
        let stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(2));
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
        assert_eq!(stage.results_of(&job).await.as_deref(), Some(&b"the archive"[..]));
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(stage.benches(), 0, "nothing is left in the spool");
    }
}

worker_test! {
    async fn progress_is_seen_while_the_job_runs() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        for fraction in [0.25, 0.5] {
            stage.order(Order::Report(fraction));
            let job = stage.until(id, |job| job.progress.fraction >= fraction).await;
            assert_eq!((job.state, job.progress.stage.as_str()), (JobState::Running, "fusing"));
        }
        stage.order(Order::Succeed);
        stage.ended(id).await;
    }
}

worker_test! {
    async fn a_job_that_fails_or_panics_does_not_kill_its_worker() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let mut codes = Vec::new();
        for order in [Order::Panic, Order::Fail] {
            let id = stage.accept().await;
            stage.order(order);
            let job = stage.ended(id).await;
            assert_eq!(job.state, JobState::Failed);
            codes.push(job.error.unwrap().code);
        }
        assert_eq!(codes, [Code::Internal, Code::InvalidImage]);
        let id = stage.accept().await;
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn a_cancel_stops_a_running_job() {
        let mut stage = stage().await;
        // a beat an hour: the cancel must come by the notice within the process
        let hourly = Duration::from_secs(3600);
        let pool = Pool::start(stage.deps.clone(), Config { beat: hourly, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        stage.deps.rows.cancel(id).await.unwrap();
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.outcome.is_none()), (JobState::Cancelled, true));
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(stage.benches(), 0);
    }
}

worker_test! {
    async fn a_cancel_by_another_process_is_seen_with_the_next_beat() {
        let mut stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        let path = stage.folder.path().join("rows.db");
        let other = SqliteRows::open_with_clock(path, stage.clock.clone()).await.unwrap();
        other.cancel(id).await.unwrap();
        assert_eq!(stage.ended(id).await.state, JobState::Cancelled);
    }
}

worker_test! {
    async fn a_running_job_that_is_deleted_stops_and_leaves_nothing() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        assert!(stage.deps.rows.delete_job(id).await.unwrap());
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(stage.deps.rows.blob_owner(id).await.unwrap(), None);
        assert!(stage.deps.blobs.jobs_with_blobs().await.unwrap().is_empty());
    }
}

worker_test! {
    async fn a_worker_that_lost_its_lease_stops_and_publishes_nothing() {
        let mut stage = stage().await;
        // it beats once at the start and then sleeps, like a process that was stopped
        let asleep = Duration::from_secs(3600);
        let pool = Pool::start(stage.deps.clone(), Config { beat: asleep, poll: asleep, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        // another process takes the job over when the lease has run out, and ends it
        let path = stage.folder.path().join("rows.db");
        let other = SqliteRows::open_with_clock(path, stage.clock.clone()).await.unwrap();
        let taken = conformance::claim_from_the_dead(&other, &stage.clock).await;
        assert_eq!((taken.id, taken.lease_token), (id, 2));
        stage.order(Order::Succeed); // the sleeper wakes up and has a result
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(conformance::job(&other, id).await, taken, "nothing of it is to be seen");
        let stale = stage.deps.blobs.local_path(&result_key(id, 1, "image.png")).await.unwrap();
        assert_eq!(stale, None, "and its files are gone");
        assert!(other.finish(id, 2, &conformance::success()).await.unwrap());
    }
}

worker_test! {
    async fn a_lost_lease_stops_the_job_with_the_next_beat() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), Config { workers: 1, ..config(1) });
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        let path = stage.folder.path().join("rows.db");
        let other = SqliteRows::open_with_clock(path, stage.clock.clone()).await.unwrap();
        // beats come between, so the lease must run out and be taken before the next one
        let taken = loop {
            // seen by the other, and then silent for a whole lease
            if let Some(taken) = other.claim(LEASE, 1000).await.unwrap() {
                break taken;
            }
            stage.clock.advance(LEASE);
        };
        pool.shutdown(Duration::from_secs(30)).await;
        assert_eq!(conformance::job(&other, id).await.lease_token, taken.lease_token);
    }
}

worker_test! {
    async fn a_shutdown_gives_unfinished_jobs_back_without_counting_the_attempt() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        assert_eq!(stage.began.recv().await, Some(id));
        stage.order(Order::WaitForStop);
        pool.shutdown(Duration::ZERO).await;
        let job = conformance::job(&*stage.deps.rows, id).await;
        assert_eq!((job.state, job.attempt), (JobState::Queued, 0));
        let _pool = Pool::start(stage.deps.clone(), config(1));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn a_shutdown_lets_running_jobs_end_and_takes_no_new_ones() {
        let mut stage = stage().await;
        let pool = Pool::start(stage.deps.clone(), config(1));
        let (running, waiting) = (stage.accept().await, stage.accept().await);
        assert_eq!(stage.began.recv().await, Some(running));
        let shutdown = tokio::spawn(pool.shutdown(Duration::from_secs(60)));
        stage.order(Order::Succeed);
        shutdown.await.unwrap();
        assert_eq!(conformance::job(&*stage.deps.rows, running).await.state, JobState::Succeeded);
        assert_eq!(conformance::job(&*stage.deps.rows, waiting).await.state, JobState::Queued);
    }
}

worker_test! {
    async fn a_job_larger_than_the_whole_budget_runs_alone_and_others_wait() {
        let mut stage = stage_with_need(100 << 30).await;
        let _pool = Pool::start(stage.deps.clone(), config(2));
        let (first, second) = (stage.accept().await, stage.accept().await);
        assert_eq!(stage.began.recv().await, Some(first));
        // the second is claimed and beats, but has no memory yet: its cancel must be seen all the same
        stage.until(second, |job| job.state == JobState::Running).await;
        assert!(stage.began.try_recv().is_err());
        stage.deps.rows.cancel(second).await.unwrap();
        assert_eq!(stage.ended(second).await.state, JobState::Cancelled);
        let third = stage.accept().await;
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(first).await.state, JobState::Succeeded);
        assert_eq!(stage.began.recv().await, Some(third));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(third).await.state, JobState::Succeeded);
    }
}

worker_test! {
    async fn small_jobs_run_side_by_side() {
        let mut stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(2));
        let (first, second) = (stage.accept().await, stage.accept().await);
        let mut began = [stage.began.recv().await.unwrap(), stage.began.recv().await.unwrap()];
        began.sort();
        let mut both = [first, second];
        both.sort();
        assert_eq!(began, both);
        stage.order(Order::Succeed);
        stage.order(Order::Succeed);
        for id in both {
            assert_eq!(stage.ended(id).await.state, JobState::Succeeded);
        }
    }
}

worker_test! {
    async fn a_job_that_lost_a_worker_before_runs_alone() {
        let mut stage = stage().await;
        let (suspect, innocent) = (stage.accept().await, stage.accept().await);
        // a worker takes the first job and dies
        conformance::claim(&*stage.deps.rows).await.expect("the suspect");
        stage.clock.advance(LEASE);
        let _pool = Pool::start(stage.deps.clone(), config(2));
        assert_eq!(stage.began.recv().await, Some(suspect));
        stage.order(Order::Report(0.5));
        stage.until(suspect, |job| job.progress.fraction == 0.5).await;
        assert_eq!(conformance::job(&*stage.deps.rows, innocent).await.state, JobState::Queued);
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(suspect).await.attempt, 2);
        assert_eq!(stage.began.recv().await, Some(innocent));
        stage.order(Order::Succeed);
        assert_eq!(stage.ended(innocent).await.attempt, 1);
    }
}

worker_test! {
    async fn a_job_whose_upload_is_gone_fails_with_a_sentence() {
        let stage = stage().await;
        let id = stage.accept().await;
        stage.deps.blobs.delete_job(id).await.unwrap();
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let job = stage.ended(id).await;
        assert_eq!(job.state, JobState::Failed);
        assert!(job.error.unwrap().detail.contains("upload"));
    }
}

/// Publishes an archive as the upload of a new job and accepts the job.
async fn accept_archive(deps: &Deps, archive: &[u8], request: impl FnOnce(Upload, StackLayout) -> JobRequest) -> Uuid {
    let id = Uuid::now_v7();
    let spooled = deps.blobs.spool_dir().join(id.to_string());
    std::fs::write(&spooled, archive).unwrap();
    let layout = archive::open(&spooled, &ArchiveLimits::default()).unwrap().layout().clone();
    let upload = Upload { key: upload_key(id), bytes: archive.len() as u64, sha256: String::new(), filename: None };
    deps.blobs.publish(&spooled, &upload.key).await.unwrap();
    let job = NewJob { id, request: request(upload, layout), ..conformance::stack() };
    accept(&*deps.rows, &job).await.id
}

worker_test! {
    async fn a_target_becomes_the_profile_that_the_next_stack_is_fused_with() {
        let mut stage = stage().await;
        stage.deps.work = Arc::new(Science::default());
        let _pool = Pool::start(stage.deps.clone(), Config { workers: 2, ..Config::default() });
        let calibration = accept_archive(&stage.deps, &testkit::target_zip(), |upload, layout| {
            JobRequest::Calibration(CalibrationRequest { options: Default::default(), upload, layout })
        })
        .await;
        let ended = stage.ended(calibration).await;
        let Some(JobOutcome::Calibration(outcome)) = ended.outcome else { panic!("{:?}", ended.error) };
        // the stage put revision 1
        // five overlays and the report
        assert_eq!((outcome.profile_revision, outcome.artifacts.len()), (2, 6));
        let profile = stage.deps.rows.profile(&ended.rig, &ended.lens, None).await.unwrap().unwrap();
        assert_eq!((profile.digest.as_str(), profile.calibration_id), (outcome.profile_digest.as_str(), Some(ended.id)));

        let stack = accept_archive(&stage.deps, &testkit::both_zip(), |upload, layout| {
            let (profile_revision, profile_digest) = (profile.revision, profile.digest.clone());
            JobRequest::Stack(StackRequest { options: Default::default(), profile_revision, profile_digest, upload, layout })
        })
        .await;
        let ended = stage.ended(stack).await;
        let Some(JobOutcome::Stack(outcome)) = ended.outcome else { panic!("{:?}", ended.error) };
        assert_eq!(outcome.artifacts.len(), 5);
        for artifact in outcome.artifacts {
            let path = stage.deps.blobs.local_path(&artifact.key).await.unwrap().expect("it is published");
            let bytes = std::fs::read(path).unwrap();
            assert_eq!((hex(&Sha256::digest(&bytes)), bytes.len() as u64), (artifact.sha256, artifact.bytes));
        }
    }
}

worker_test! {
    async fn a_job_under_which_the_disk_becomes_full_is_tried_again_and_not_for_ever() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        stage.order(Order::Full);
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 2));
        let id = stage.accept().await;
        for _ in 0..3 {
            stage.order(Order::Full);
        }
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Failed, 3));
        assert_eq!(job.error.unwrap().code, Code::InsufficientStorage);
    }
}

worker_test! {
    async fn a_job_that_could_never_fit_on_the_disk_fails_with_figures() {
        let stage = stage_with_needs(1, u64::MAX).await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let job = stage.ended(stage.accept().await).await;
        let error = job.error.expect("it failed");
        assert_eq!(error.code, Code::InsufficientStorage);
        assert!(error.detail.contains(&u64::MAX.to_string()), "{}", error.detail);
    }
}

worker_test! {
    async fn a_job_waits_for_room_on_the_disk_and_can_be_cancelled_meanwhile() {
        let stage = stage_with_needs(1, 1).await;
        let full = Arc::new(FullDisk { blobs: Arc::clone(&stage.deps.blobs), free: AtomicU64::new(0) });
        let deps = Deps { blobs: full.clone(), ..stage.deps.clone() };
        let _pool = Pool::start(deps, config(1));
        let (cancelled, waiting) = (stage.accept().await, stage.accept().await);
        let waits = |job: &Job| job.state == JobState::Running && job.progress.stage.contains("room on the disk");
        stage.until(cancelled, waits).await;
        stage.deps.rows.cancel(cancelled).await.unwrap();
        assert_eq!(stage.ended(cancelled).await.state, JobState::Cancelled);
        stage.until(waiting, waits).await;
        full.free.store(1, Ordering::SeqCst);
        stage.order(Order::Succeed);
        let job = stage.ended(waiting).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
    }
}

/// Blobs on a disk that has as much room as a test says.
struct FullDisk {
    blobs: Arc<dyn Blobs>,
    free: AtomicU64,
}

#[async_trait::async_trait]
impl Blobs for FullDisk {
    async fn room(&self) -> StoreResult<Room> {
        Ok(Room { free: self.free.load(Ordering::SeqCst), total: 1000 })
    }
    fn spool_dir(&self) -> &Path {
        self.blobs.spool_dir()
    }
    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()> {
        self.blobs.publish(path, key).await
    }
    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>> {
        self.blobs.local_path(key).await
    }
    async fn delete_job(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.delete_job(id).await
    }
    async fn delete_upload(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.delete_upload(id).await
    }
    async fn delete_stale_results(&self, id: Uuid, first_kept: i64) -> StoreResult<()> {
        self.blobs.delete_stale_results(id, first_kept).await
    }
    async fn jobs_with_blobs(&self) -> StoreResult<Vec<JobBlobs>> {
        self.blobs.jobs_with_blobs().await
    }
    async fn hold_partial(&self, id: Uuid) -> StoreResult<Option<Box<dyn Partial>>> {
        self.blobs.hold_partial(id).await
    }
    async fn remove_partial(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.remove_partial(id).await
    }
    async fn partials(&self) -> StoreResult<Vec<Uuid>> {
        self.blobs.partials().await
    }
}
