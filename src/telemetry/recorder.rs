//! The recorder of this process: it keeps counters and histograms between two scrapes.

use std::{sync::OnceLock, time::Instant};

use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};

use super::{
    events,
    series::{ALL, Kind},
};

/// Upper bounds of the histogram buckets, seconds: from a health check to a large upload or a long queue.
const SECONDS: [f64; 14] = [0.001, 0.005, 0.02, 0.1, 0.5, 1.0, 2.0, 5.0, 20.0, 60.0, 300.0, 1800.0, 7200.0, 43200.0];

/// The recorder of the process.
pub struct Recorder {
    handle: PrometheusHandle,
    started: Instant,
}

impl Recorder {
    /// The series in the text format.
    pub fn render(&self) -> String {
        self.handle.render()
    }

    /// Moves observations to their buckets. They accumulate in memory until then.
    pub fn run_upkeep(&self) {
        self.handle.run_upkeep();
    }

    /// When it was installed, which is when the service started.
    pub fn started(&self) -> Instant {
        self.started
    }
}

/// The recorder of this process, installed by the first call. Earlier events are not counted.
///
/// # Errors
/// When another recorder is installed already.
pub fn recorder() -> Result<&'static Recorder, &'static str> {
    static RECORDER: OnceLock<Option<Recorder>> = OnceLock::new();
    let recorder = RECORDER.get_or_init(|| {
        let handle = PrometheusBuilder::new().set_buckets(&SECONDS).ok()?.install_recorder().ok()?;
        for series in ALL {
            match series.kind {
                Kind::Counter => metrics::describe_counter!(series.name, series.help),
                Kind::Gauge => metrics::describe_gauge!(series.name, series.help),
                Kind::Histogram => metrics::describe_histogram!(series.name, series.help),
            }
        }
        events::begin();
        Some(Recorder { handle, started: Instant::now() })
    });
    recorder.as_ref().ok_or("the metrics recorder could not be installed")
}
