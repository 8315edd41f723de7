//! A job runner that a test scripts.

use std::sync::{Mutex, mpsc};

use tokio::sync::mpsc as async_mpsc;
use uuid::Uuid;

use crate::{
    contract::{Code, Fault, JobError, Progress, request::JobRequest},
    jobs::{JobContext, JobOutput, OutputFile, ProgressSink},
    store::{blobs::result_key, conformance},
    worker::JobRunner,
};

/// The next action of a scripted job.
pub(super) enum Order {
    /// Report this fraction.
    Report(f64),
    /// Wait until it is cancelled, and stop.
    WaitForStop,
    Succeed,
    Fail,
    /// Fail with a full disk.
    Full,
    /// Fail with an error of the machine.
    Unavailable,
    Panic,
}

/// Announces each job that starts, then follows the orders of the test.
pub(super) struct ScriptedRunner {
    pub began: async_mpsc::UnboundedSender<Uuid>,
    pub orders: Mutex<mpsc::Receiver<Order>>,
    pub need: u64,
    pub disk_need: u64,
}

impl JobRunner for ScriptedRunner {
    fn memory_need(&self, _request: &JobRequest) -> u64 {
        self.need
    }

    fn disk_need(&self, _request: &JobRequest) -> u64 {
        self.disk_need
    }

    fn run(&self, context: &JobContext, sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
        let _ = self.began.send(context.job.id);
        loop {
            let order = self.orders.lock().unwrap().recv();
            match order {
                Ok(Order::Report(fraction)) => {
                    sink.report(Progress { stage: "fusing".into(), completed: 1, total: 2, fraction });
                }
                Ok(Order::WaitForStop) => loop {
                    sink.check()?;
                    std::thread::sleep(std::time::Duration::from_millis(1));
                },
                Ok(Order::Fail) => return Err(Fault::new(Code::InvalidImage, "torn").into()),
                Ok(Order::Full) => return Err(Fault::new(Code::InsufficientStorage, "full").into()),
                Ok(Order::Unavailable) => return Err(Fault::new(Code::Unavailable, "too many open files").into()),
                Ok(Order::Panic) => panic!("a bug, made for the test"),
                Ok(Order::Succeed) => return Ok(output(context)),
                Err(_) => return Err(Fault::new(Code::Internal, "the test is over").into()),
            }
        }
    }
}

fn output(context: &JobContext) -> JobOutput {
    let path = context.scratch.join("image.png");
    let mut zip = vec![0; context.archive.length().unwrap() as usize];
    context.archive.read_exact_at(&mut zip, 0).unwrap();
    std::fs::write(&path, zip).unwrap();
    let key = result_key(context.job.id, context.job.lease_token, "image.png");
    let files = vec![OutputFile { path, key }];
    JobOutput { outcome: conformance::stack_outcome(), warnings: vec![], profile: None, files }
}
