//! CPU time, wall time and memory of a piece of work.

use std::{
    fs,
    path::PathBuf,
    sync::Mutex,
    time::{Duration, Instant},
};

use pinstack_science::types::{Cancelled, Control};

/// CPU time of all threads of this process that are alive.
pub fn cpu() -> Duration {
    let threads = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let of_thread = |folder: PathBuf| -> Option<u64> {
        fs::read_to_string(folder.join("schedstat")).ok()?.split_whitespace().next()?.parse().ok()
    };
    Duration::from_nanos(threads.filter_map(|thread| of_thread(thread.path())).sum())
}

/// Peak of memory of a process, MB.
pub fn peak_mb(process: &str) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.split_whitespace().next()?.parse::<f64>().ok()? * 1024.0 / 1e6)
}

/// CPU time of the children that have ended, s, as the system counts it: in hundredths.
pub fn children() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // the fields after the name, which is in brackets: user and system time of children are the 14th and 15th
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|ticks| ticks.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(13) + ticks(14)) / 100.0
}

/// What a row of the table says.
#[derive(Debug, Clone, Copy)]
pub struct Cost {
    pub cpu: f64,
    pub wall: f64,
    pub peak_mb: Option<f64>,
}

/// Time spent in what is given to it.
#[derive(Default)]
pub struct Watchmaker(Mutex<(Duration, Duration)>);

impl Watchmaker {
    pub fn time<T>(&self, work: impl FnOnce() -> T) -> T {
        let (cpu_before, wall_before) = (cpu(), Instant::now());
        let result = work();
        let mut sums = self.0.lock().expect("no thread panicked");
        sums.0 += cpu() - cpu_before;
        sums.1 += wall_before.elapsed();
        result
    }

    pub fn cost(&self) -> Cost {
        let (cpu, wall) = *self.0.lock().expect("no thread panicked");
        Cost { cpu: cpu.as_secs_f64(), wall: wall.as_secs_f64(), peak_mb: peak_mb("self") }
    }
}

/// Notes when the second pass begins.
pub struct Passes(pub Mutex<Option<(Duration, Instant)>>);

impl Control for Passes {
    fn progress(&self, stage: &'static str, _completed: usize, _total: usize) {
        let mut second = self.0.lock().expect("no thread panicked");
        if stage == "fusing" && second.is_none() {
            *second = Some((cpu(), Instant::now()));
        }
    }

    fn check(&self) -> Result<(), Cancelled> {
        Ok(())
    }
}
