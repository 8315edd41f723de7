//! The database: reachable, readable by this version, with a clock that agrees, and the tokens in it.

use std::time::Duration;

use anyhow::anyhow;
use tokio::time::timeout;

use super::finding::Finding;
use crate::{
    settings::{Auth, Settings},
    store::{
        DatabaseUrl, StoreResult,
        inspection::{Inspection, Rows, of_database, of_folder},
    },
};

/// A larger difference from the clock of the database is a warning, ms.
const MAX_CLOCK_DIFFERENCE_MS: i64 = 5_000;

/// How long a database on another machine may take to answer.
const ANSWER: Duration = Duration::from_secs(10);

async fn answer_of(url: &DatabaseUrl) -> StoreResult<Option<Inspection>> {
    let answer = timeout(ANSWER, of_database(url)).await;
    answer.unwrap_or_else(|_| Err(anyhow!("it does not answer within {} s", ANSWER.as_secs()).into())).map(Some)
}

/// What the database says, and its numbers of rows.
pub(super) async fn findings(config: &Settings) -> (Vec<Finding>, Option<Rows>) {
    let url = match config.database() {
        Ok(url) => url,
        Err(error) => return (vec![Finding::problem("database", format!("{error:#}"))], None),
    };
    let (inspected, place) = match &url {
        Some(url) => (answer_of(url).await, format!("Postgres, {url}")),
        None => (of_folder(&config.data_dir).await, format!("SQLite in {}", config.data_dir.display())),
    };
    let inspection = match inspected {
        Ok(Some(inspection)) => inspection,
        Ok(None) => {
            let detail = format!("{place}: there is none yet; the first start of the server makes it");
            return (vec![Finding::ok("database", detail)], None);
        }
        Err(error) => {
            let detail = format!(
                "{place} cannot be read: {error:#}; check that it runs, the address and the password, or the rights of \
                 the file"
            );
            return (vec![Finding::problem("database", detail)], None);
        }
    };
    let mut findings = vec![schema(&inspection, &place)];
    findings.extend(inspection.clock_ms.map(clock));
    (findings, inspection.rows)
}

fn schema(inspection: &Inspection, place: &str) -> Finding {
    let Inspection { schema, newest_schema, refused, rows, .. } = inspection;
    if let Some(refused) = refused {
        return Finding::problem("database", format!("{place}: it {refused}"));
    }
    match (rows, schema.cmp(newest_schema)) {
        (_, std::cmp::Ordering::Greater) => Finding::problem(
            "database",
            format!(
                "{place}: a newer version of pinstack wrote it (schema {schema}, this one knows {newest_schema}); run that \
                 version or a later one"
            ),
        ),
        (Some(Rows { profiles, queued, .. }), _) => {
            Finding::ok("database", format!("{place}: {profiles} profiles, {queued} queued jobs"))
        }
        (None, _) if *schema == 0 => {
            Finding::ok("database", format!("{place}: empty; the first start of the server makes the tables"))
        }
        (None, _) => Finding::warning(
            "database",
            format!(
                "{place}: an older version of pinstack wrote it (schema {schema} of {newest_schema}); the next start \
                 migrates it, and the older version cannot use it any more: back it up first"
            ),
        ),
    }
}

fn clock(of_database: i64) -> Finding {
    let here = jiff::Timestamp::now().as_millisecond();
    let seconds = (here - of_database) / 1000;
    if (here - of_database).abs() <= MAX_CLOCK_DIFFERENCE_MS {
        return Finding::ok("clock", "agrees with that of the database");
    }
    let detail = format!(
        "differs by {seconds} s from that of the database; leases go by the database, but log lines and certificates do \
         not: set both by NTP"
    );
    Finding::warning("clock", detail)
}

/// Whether clients can get in, and whether too many can.
pub(super) fn tokens(config: &Settings, rows: Option<Rows>) -> Option<Finding> {
    let host = config.listen.rsplit_once(':').map_or(config.listen.as_str(), |(host, _)| host);
    let host = host.trim_start_matches('[').trim_end_matches(']');
    let is_local = host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback());
    let (all, valid) = rows.map_or((0, 0), |rows| (rows.tokens, rows.valid_tokens));
    let how = "make one with 'pinstack token add NAME --scope admin'";
    Some(match (config.auth, is_local, all, valid) {
        (Auth::None, false, ..) => Finding::warning(
            "tokens",
            format!(
                "auth = none, and other machines reach {host}: every client may do everything; {how}, and remove auth"
            ),
        ),
        (Auth::None, true, ..) => Finding::ok("tokens", "none is required (auth = none)"),
        (Auth::Tokens, _, _, 0) | (Auth::Auto, _, 1.., 0) => Finding::problem(
            "tokens",
            format!("a token is required and none is valid: every request is refused; {how}"),
        ),
        (Auth::Auto, false, 0, _) => Finding::problem(
            "tokens",
            format!("other machines reach {host} and there is no token: the server does not start; {how}"),
        ),
        (Auth::Auto, true, 0, _) => Finding::ok("tokens", "none is required: only this machine reaches the server"),
        _ => Finding::ok("tokens", format!("{valid} valid")),
    })
}
