//! Lists of jobs: those that match, newest first, and how many there are. [`crate::store::search`] has the terms.
//!
//! A statement has only the conditions of its filter, so that the engine can choose by them. One term drives it: of
//! several, the one with the fewest rows. `CROSS JOIN` makes SQLite begin with it.

use jiff::Timestamp;
use sqlx::{Executor, QueryBuilder};
use uuid::Uuid;

use super::engine::{Connection, Db, Metadata};
use crate::{
    contract::{JobKind, JobState, Name, Verdict},
    store::{
        Job, JobFilter, Page, PageRequest, StoreResult, json,
        rows::{
            JobRow, kind, listed,
            page::Window,
            state,
            transaction::{Lock, Notice},
            unsigned,
        },
        search::{self, FoundStacks},
    },
};

/// Jobs that are indexed anew at a time.
const BATCH: i64 = 200;
/// Up to this number the rows of a term are counted to find the term that drives a search.
const FEW: i64 = 2_000;

/// Which rows a search reads: its terms, the one with the fewest rows first, and the sequence numbers.
struct Search<'a> {
    filter: &'a JobFilter,
    terms: Vec<String>,
    from: i64,
    before: i64,
}

impl<'a> Search<'a> {
    async fn of(store: &Metadata, filter: &'a JobFilter, before: i64) -> StoreResult<Self> {
        let mut terms: Vec<String> = Vec::new();
        if let Some(kind) = filter.kind {
            let fields = [("rig", &filter.rig), ("lens", &filter.lens), ("scan", &filter.scan)];
            let exact = fields.into_iter().filter_map(|(field, name)| Some((field, name.as_ref()?)));
            terms.extend(exact.map(|(field, name)| search::exactly(kind, field, name.as_str())));
            terms.extend(filter.zip.iter().map(|digest| search::exactly(kind, search::ZIP, digest)));
            let verdict = filter.verdict.map(|verdict| format!("{}{}", search::letter(kind), search::verdict(verdict)));
            terms.extend(verdict);
            if filter.state == Some(JobState::Failed) {
                terms.push(format!("{}{}", search::letter(kind), search::FAILED));
            }
            terms.extend(search::wanted(kind, filter.q.as_deref().unwrap_or_default()));
        }
        if terms.len() > 1 {
            let mut counted = Vec::with_capacity(terms.len());
            for term in terms {
                let rows: i64 = sqlx::query_scalar(
                    "SELECT count(*) FROM (SELECT 1 FROM search_terms WHERE term = $1 LIMIT $2) AS few",
                )
                .bind(&term)
                .bind(FEW)
                .fetch_one(store.reading())
                .await?;
                counted.push((rows, term));
            }
            counted.sort();
            terms = counted.into_iter().map(|(_, term)| term).collect();
        }
        let from = match filter.since {
            Some(since) => first_at(store, since).await?.unwrap_or(i64::MAX),
            None => 0,
        };
        let until = match filter.until {
            Some(until) => first_at(store, until).await?.unwrap_or(i64::MAX),
            None => i64::MAX,
        };
        Ok(Self { filter, terms, from, before: before.min(until) })
    }

    /// Whether a term drives the search. Few jobs run or wait: a search for these states is driven by the rows of the
    /// jobs. Most jobs have succeeded, and those that failed have a term.
    fn by_term(&self) -> bool {
        let is_rare = |state| !matches!(state, JobState::Succeeded | JobState::Failed);
        !self.terms.is_empty() && !self.filter.state.is_some_and(is_rare)
    }

    /// The name of the sequence number in the table that drives the search.
    fn seq(&self) -> &'static str {
        if self.by_term() { "driver.seq" } else { "jobs.seq" }
    }

    /// `FROM` and `WHERE`. `with_jobs`: the rows of jobs are read.
    fn push(&self, query: &mut QueryBuilder<Db>, with_jobs: bool) {
        let seq = self.seq();
        let others = match self.terms.split_first().filter(|_| self.by_term()) {
            None => {
                query.push(" FROM jobs WHERE ");
                &self.terms[..]
            }
            Some((first, others)) => {
                query.push(" FROM search_terms AS driver ");
                query.push(if with_jobs { "CROSS JOIN jobs WHERE jobs.seq = driver.seq AND " } else { "WHERE " });
                query.push("driver.term = ").push_bind(first.clone()).push(" AND ");
                others
            }
        };
        for term in others {
            query.push("EXISTS (SELECT 1 FROM search_terms AS other WHERE other.term = ").push_bind(term.clone());
            query.push(" AND other.seq = ").push(seq).push(") AND ");
        }
        query.push(seq).push(" < ").push_bind(self.before);
        query.push(" AND ").push(seq).push(" >= ").push_bind(self.from);
        if with_jobs || !self.by_term() {
            self.push_of_jobs(query);
        }
    }

    /// Conditions on the rows of jobs. What a term says too is not repeated, except for lists of all kinds.
    fn push_of_jobs(&self, query: &mut QueryBuilder<Db>) {
        let JobFilter { kind, state, rig, lens, scan, owner, .. } = self.filter;
        let text = |name: &Option<Name>| name.as_ref().filter(|_| kind.is_none()).map(|name| name.as_str().to_owned());
        let is_failed = kind.is_some() && *state == Some(JobState::Failed);
        for (column, value) in [
            ("kind", kind.map(|kind| kind.as_str().to_owned())),
            ("state", state.filter(|_| !is_failed).map(|state| state.as_str().to_owned())),
            ("rig", text(rig)),
            ("lens", text(lens)),
            ("scan", text(scan)),
        ] {
            if let Some(value) = value {
                query.push(" AND jobs.").push(column).push(" = ").push_bind(value);
            }
        }
        if let Some(owner) = owner {
            query.push(" AND (jobs.owner IS NULL OR jobs.owner = ").push_bind(*owner).push(")");
        }
    }

    /// The number of jobs that match, up to the most that are counted.
    async fn count(&self, store: &Metadata) -> StoreResult<u64> {
        let is_in_rows = self.filter.owner.is_some() || self.filter.state.is_some_and(|it| it != JobState::Failed);
        let mut query = QueryBuilder::<Db>::new("SELECT count(*) FROM (SELECT 1");
        self.push(&mut query, is_in_rows);
        query.push(" LIMIT ").push_bind(FoundStacks::MOST as i64).push(") AS found");
        Ok(unsigned(query.build_query_scalar().fetch_one(store.reading()).await?))
    }
}

/// The first job that was accepted at this time or later.
async fn first_at(store: &Metadata, time: Timestamp) -> StoreResult<Option<i64>> {
    let first = sqlx::query_scalar("SELECT seq FROM jobs WHERE created_at >= $1 ORDER BY created_at, seq LIMIT 1");
    Ok(first.bind(time.as_millisecond()).fetch_optional(store.reading()).await?)
}

/// A page of the jobs that match.
pub(super) async fn jobs(store: &Metadata, filter: &JobFilter, page: &PageRequest) -> StoreResult<Page<Job>> {
    let window = Window::of(filter.kind.map_or("jobs", JobKind::as_str), page)?;
    let search = Search::of(store, filter, window.before).await?;
    let mut query = QueryBuilder::<Db>::new("SELECT jobs.*");
    search.push(&mut query, true);
    query
        .push(" AND NOT jobs.delete_requested ORDER BY ")
        .push(search.seq())
        .push(" DESC LIMIT ")
        .push_bind(window.rows);
    let rows = query.build_query_as().fetch(store.reading());
    let (rows, next_cursor) = window.fill(rows, |row: &JobRow| (row.seq, row.bytes())).await?;
    listed(rows, next_cursor).await
}

/// The numbers of stacks that match, by verdict. A verdict of the filter, or a state, is left out.
pub(super) async fn found(store: &Metadata, filter: &JobFilter) -> StoreResult<FoundStacks> {
    let all = JobFilter { kind: Some(JobKind::Stack), verdict: None, state: None, ..filter.clone() };
    let count = async |filter: &JobFilter| Search::of(store, filter, i64::MAX).await?.count(store).await;
    let mut found = FoundStacks { all: count(&all).await?, ..FoundStacks::default() };
    for (number, verdict) in found.verdicts.iter_mut().zip(Verdict::ALL) {
        *number = count(&JobFilter { verdict: Some(verdict), ..all.clone() }).await?;
    }
    found.failed = count(&JobFilter { state: Some(JobState::Failed), ..all }).await?;
    Ok(found)
}

/// Indexes a job under these terms.
pub(super) async fn index(
    connection: &mut Connection,
    seq: i64,
    terms: impl IntoIterator<Item = String>,
) -> StoreResult<()> {
    let mut insert = QueryBuilder::<Db>::new("INSERT INTO search_terms (term, seq) ");
    insert.push_values(terms, |mut row, term| {
        row.push_bind(term).push_bind(seq);
    });
    insert.push(" ON CONFLICT DO NOTHING").build().execute(connection).await?;
    Ok(())
}

/// Indexes a job under how it ended. `term` is the part of the term after the letter of the kind.
pub(super) async fn index_end(executor: impl Executor<'_, Database = Db>, id: Uuid, term: &str) -> StoreResult<()> {
    sqlx::query(
        "INSERT INTO search_terms (term, seq) SELECT substr(kind, 1, 1) || $2, seq FROM jobs WHERE id = $1
         ON CONFLICT DO NOTHING",
    )
    .bind(id)
    .bind(term)
    .execute(executor)
    .await?;
    Ok(())
}

/// Indexes all jobs anew if another version of the program indexed them, or none.
pub(in crate::store) async fn refresh(store: &Metadata) -> StoreResult<()> {
    let version = "SELECT version FROM search_index";
    if sqlx::query_scalar::<_, i64>(version).fetch_one(store.reading()).await? == search::VERSION {
        return Ok(());
    }
    let mut tx = store.write_alone(Lock::Accept).await?;
    if sqlx::query_scalar::<_, i64>(version).fetch_one(&mut *tx).await? == search::VERSION {
        return Ok(());
    }
    sqlx::query("DELETE FROM search_terms").execute(&mut *tx).await?;
    let mut last = 0;
    loop {
        let rows: Vec<(i64, String, String, String, String, String, String)> = sqlx::query_as(
            "SELECT seq, kind, rig, lens, request, state, warnings FROM jobs WHERE seq > $1 ORDER BY seq LIMIT $2",
        )
        .bind(last)
        .bind(BATCH)
        .fetch_all(&mut *tx)
        .await?;
        let Some(newest) = rows.last().map(|row| row.0) else { break };
        last = newest;
        for (seq, kind_name, rig, lens, request, state_name, warnings) in rows {
            let label = format!("row {seq} of jobs");
            // a row that cannot be read is found by nothing; lists name it
            let (Ok(request), Ok(warnings)) = (json::read(&label, &request), json::read::<Vec<_>>(&label, &warnings))
            else {
                continue;
            };
            let kind = kind(&kind_name)?;
            let end = search::ended(kind, state(&state_name)?, &warnings);
            let end = end.map(|end| format!("{}{end}", search::letter(kind)));
            index(&mut tx, seq, search::terms(&rig, &lens, &request).into_iter().chain(end)).await?;
        }
    }
    sqlx::query("UPDATE search_index SET version = $1").bind(search::VERSION).execute(&mut *tx).await?;
    store.commit(tx, "rows.index", Notice::None).await
}
