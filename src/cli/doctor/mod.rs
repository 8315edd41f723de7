//! `pinstack doctor`: whether a service can run here with these settings, and what to do if not.
//!
//! It changes nothing: the database is read, not opened for writing, and the probe of the data folder removes its file.

mod collector;
mod database;
mod finding;
mod machine;
mod storage;

use anyhow::bail;
use clap::Args;

use self::finding::{Finding, Level};
use super::{output::say, store::Place};
use crate::settings::Settings;

/// Check settings, data folder, disk, memory, open files, COLMAP, database, bucket, collector of traces, tokens and
/// address of a service, and say what to do. Nothing is changed, and a server may run meanwhile. The exit code is 1 if
/// there is a problem.
#[derive(Debug, Args)]
pub struct Doctor {
    #[command(flatten)]
    place: Place,
    /// Print the findings as JSON
    #[arg(long)]
    json: bool,
}

impl Doctor {
    /// Runs the command.
    ///
    /// # Errors
    /// When there is a problem.
    pub fn run(self) -> anyhow::Result<()> {
        let json = self.json;
        let findings = match self.place.settings() {
            Ok(config) => findings(&config)?,
            Err(error) => vec![Finding::problem("settings", format!("{error:#}"))],
        };
        say(if json { serde_json::to_string_pretty(&findings)? } else { lines(&findings).trim_end().to_owned() });
        let problems = findings.iter().filter(|finding| finding.level == Level::Problem).count();
        if problems > 0 {
            bail!("{problems} of {} checks found a problem", findings.len());
        }
        Ok(())
    }
}

fn findings(config: &Settings) -> anyhow::Result<Vec<Finding>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let mut findings = vec![Finding::ok("settings", "every setting is known and in its range")];
        findings.push(machine::data_folder(config));
        findings.push(machine::disk(config));
        findings.push(machine::memory(config));
        findings.push(machine::open_files(config));
        findings.push(machine::colmap(config));
        let (of_database, rows) = database::findings(config).await;
        findings.extend(of_database);
        findings.extend(storage::finding(config).await);
        findings.extend(collector::finding(config).await);
        findings.extend(machine::address(config).await);
        findings.extend(database::tokens(config, rows));
        Ok(findings)
    })
}

fn lines(findings: &[Finding]) -> String {
    let line = |Finding { check, level, detail }: &Finding| {
        let level = match level {
            Level::Ok => "ok",
            Level::Warning => "warning",
            Level::Problem => "PROBLEM",
        };
        format!("{level:<8} {check}: {detail}\n")
    };
    findings.iter().map(line).collect()
}
