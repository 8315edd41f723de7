//! Jobs that do what a test tells them.

use std::sync::{Mutex, mpsc};

use tokio::sync::mpsc as async_mpsc;
use uuid::Uuid;

use crate::contract::JobError;
use crate::{
    contract::{Code, Fault, Progress, request::JobRequest},
    jobs::{JobContext, JobOutput, OutputFile, ProgressSink},
    store::{blobs::result_key, conformance},
    worker::JobRunner,
};

/// What a job in a test is told to do next.
pub(super) enum Order {
    /// Report this fraction.
    Report(f64),
    /// Wait until it is not wanted any more, and stop.
    WaitForStop,
    Succeed,
    Fail,
    /// The disk became full under it.
    Full,
    /// The machine fails under it.
    Unavailable,
    Panic,
}

/// Work that says that it began and then does what it is ordered to.
pub(super) struct Puppet {
    pub began: async_mpsc::UnboundedSender<Uuid>,
    pub orders: Mutex<mpsc::Receiver<Order>>,
    pub need: u64,
    pub disk_need: u64,
}

impl JobRunner for Puppet {
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
                    std::thread::yield_now();
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
    std::fs::write(&path, std::fs::read(&context.archive).unwrap()).unwrap();
    let key = result_key(context.job.id, context.job.lease_token, "image.png");
    let files = vec![OutputFile { path, key }];
    JobOutput { outcome: conformance::stack_outcome(), warnings: vec![], profile: None, files }
}
