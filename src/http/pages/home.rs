//! `/`, the home page: the jobs in progress, the results to look at since the last visit, the number of stacks of the
//! last seven days, the free disk space, and each rig with the age and the drift of its profile.

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, Uri, header},
    response::{IntoResponse, Redirect, Response},
};
use jiff::{SignedDuration, Timestamp};
use maud::{Markup, html};

use super::{
    frame::{Frame, PageUser, Place, respond},
    stacks::{row, search},
    words::{ago, bytes, sentence},
};
use crate::{
    contract::{JobKind, JobState, ProfileSummary, Verdict},
    http::{
        ApiResult, App,
        auth::Caller,
        extract::params,
        links,
        profiles::drift::{before, between},
    },
    store::{Job, JobFilter, PageRequest},
};

/// Rows of a list of this page.
const ROWS: usize = 12;
/// Rigs of this page: two revisions of each are read whole.
const RIGS: u32 = 8;
/// The cookie with the times of the last visit and of the one before, ms.
const VISIT: &str = "pinstack_visit";
/// A visit ends when no page was opened for this long.
const PAUSE: SignedDuration = SignedDuration::from_mins(30);
const WEEK: SignedDuration = SignedDuration::from_hours(7 * 24);

/// The page, or what runs alone for the script that follows it (`?part=now`). With the parameters of the list of
/// stacks, which was at this address once, it leads there.
///
/// # Errors
/// When the store cannot be read.
pub async fn page(
    State(app): State<App>,
    caller: Caller,
    user: PageUser,
    uri: Uri,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let mut pairs = params::pairs(&uri)?;
    let is_part = params::take(&mut pairs, "part").is_some();
    if let Some(query) = uri.query().filter(|_| !pairs.is_empty()) {
        return Ok(Redirect::to(&link!("/stacks?{query}")).into_response());
    }
    let now = Timestamp::now();
    let running = running(&app, &caller, now).await?;
    if is_part {
        return Ok(respond(running));
    }
    let visits = Visits::of(&headers, now);
    let week = JobFilter { since: now.checked_sub(WEEK).ok(), ..stacks(&app, &caller) };
    let week = app.store.metadata.found(&week).await?;
    let frame = Frame { title: "Home", place: Place::Home, user: Some(&user), script: Some("home.js") };
    let mut answer = frame.answer(html! {
        div.head {
            div { h1 { "Home" } }
            @if user.stacks { a.button.main href=(link!("/send")) { "Send pictures" } }
        }
        section aria-label="In progress" { h2 { "In progress" } div id="now" { (running) } }
        (needs_a_look(&app, &caller, visits.before, now).await?)
        div.columns {
            section {
                h2 { "The last seven days" }
                p { (search::numbers(&week)) "." }
                p { a href=(link!("/stacks")) { "All stacks" } }
            }
            (disk(&app).await)
        }
        (rigs(&app, now).await?)
    });
    answer.headers_mut().extend(visits.cookie().map(|cookie| (header::SET_COOKIE, cookie)));
    Ok(answer)
}

fn stacks(app: &App, caller: &Caller) -> JobFilter {
    JobFilter { kind: Some(JobKind::Stack), owner: caller.sees_only(app), ..JobFilter::default() }
}

async fn first(app: &App, filter: JobFilter) -> ApiResult<Vec<Job>> {
    let page = PageRequest { limit: ROWS as u32, cursor: None };
    Ok(app.store.metadata.jobs(&filter, &page).await?.items)
}

async fn running(app: &App, caller: &Caller, now: Timestamp) -> ApiResult<Markup> {
    let mut jobs = Vec::new();
    for state in [JobState::Running, JobState::Queued] {
        let calibrations = JobFilter { kind: Some(JobKind::Calibration), ..JobFilter::default() };
        for filter in [calibrations, stacks(app, caller)] {
            jobs.extend(first(app, JobFilter { state: Some(state), ..filter }).await?);
        }
    }
    jobs.truncate(ROWS);
    let queue = row::queue(app, &jobs).await?;
    Ok(html! {
        @if jobs.is_empty() { p.soft { "Nothing runs, and nothing waits." } }
        ol.rows { @for job in &jobs { (row::row(job, &queue, now)) } }
        @if jobs.len() == ROWS { p { a href=(link!("/stacks?state=queued")) { "All that wait" } } }
    })
}

/// What failed, or has another verdict than `use`, since the last visit.
async fn needs_a_look(app: &App, caller: &Caller, since: Timestamp, now: Timestamp) -> ApiResult<Markup> {
    let failed = JobFilter { state: Some(JobState::Failed), ..JobFilter::default() };
    let filters = [
        JobFilter { verdict: Some(Verdict::DoNotUse), ..stacks(app, caller) },
        JobFilter { verdict: Some(Verdict::Look), ..stacks(app, caller) },
        JobFilter { state: failed.state, ..stacks(app, caller) },
        JobFilter { kind: Some(JobKind::Calibration), ..failed },
    ];
    let mut jobs = Vec::new();
    for filter in filters {
        jobs.extend(first(app, filter).await?.into_iter().filter(|job| job.finished_at.is_some_and(|at| at >= since)));
    }
    jobs.sort_by_key(|job| std::cmp::Reverse(job.finished_at));
    let is_more = jobs.len() > ROWS;
    jobs.truncate(ROWS);
    Ok(html! {
        section {
            h2 { "To look at since your last visit" }
            @if jobs.is_empty() { p.soft { "Nothing failed and nothing needs a look since then (" (ago(since, now)) ")." } }
            ol.rows { @for job in &jobs { (row::row(job, &[], now)) } }
            p {
                @if is_more { "There is more: " }
                a href=(link!("/stacks?verdict=do_not_use")) { "all that should not be used" } " · "
                a href=(link!("/stacks?verdict=look")) { "all to look at" } " · "
                a href=(link!("/stacks?state=failed")) { "all that failed" }
            }
        }
    })
}

async fn disk(app: &App) -> Markup {
    let state = app.disk.state().await.ok();
    html! {
        section {
            h2 { "Disk" }
            @match state {
                Some(disk) => {
                    @let used = disk.total.saturating_sub(disk.free);
                    progress max="1" value=(format!("{:.3}", used as f64 / disk.total.max(1) as f64)) aria-label="Used disk space" {}
                    p { (bytes(disk.free)) " of " (bytes(disk.total)) " are free"
                        @if disk.reserved > 0 { ", " (bytes(disk.reserved)) " of them reserved" }
                        ". " (bytes(disk.min_free)) " must stay free." }
                    @if disk.free <= disk.min_free { p.bad { "The disk is full: nothing is accepted until space is free." } }
                }
                None => p.bad { "The disk cannot be measured; see the log of the service." },
            }
        }
    }
}

async fn rigs(app: &App, now: Timestamp) -> ApiResult<Markup> {
    let page = app.store.metadata.profiles(None, None, &PageRequest { limit: RIGS, cursor: None }).await?;
    let mut rows = Vec::new();
    for profile in &page.items {
        rows.push((profile, drift(app, profile).await?));
    }
    Ok(html! {
        @if !rows.is_empty() {
            h2 { "Rigs" }
            div.wide tabindex="0" role="region" aria-label="Rigs" { table {
                thead { tr { @for head in ["Rig and lens", "Profile", "Written", "Drift"] { th.l scope="col" { (head) } } } }
                tbody { @for (profile, drift) in &rows { tr {
                    td.l { a href=(link!("/profiles/{}/{}", profile.rig, profile.lens)) { (profile.rig) " · " (profile.lens) } }
                    td.l { "revision " (profile.revision) }
                    td.l { (ago(profile.created_at, now)) }
                    td.l { (drift.as_deref().map_or_else(|| html! { "–" }, |detail| html! { (sentence(detail)) })) }
                } } }
            } }
            @if page.next_cursor.is_some() { p { a href=(link!("/profiles")) { "All profiles" } } }
        }
    })
}

/// How far the rig moved between its last two revisions, as a sentence; `None` for the first.
async fn drift(app: &App, profile: &ProfileSummary) -> ApiResult<Option<String>> {
    let (rig, lens) = (&profile.rig, &profile.lens);
    let Some(older) = before(app, rig, lens, profile.revision).await? else { return Ok(None) };
    let newer = app.store.metadata.profile(rig, lens, Some(profile.revision)).await?;
    Ok(newer.map(|newer| between(&older, &newer).detail))
}

/// When a person was here.
struct Visits {
    /// When the visit before this one ended.
    before: Timestamp,
    /// Now.
    last: Timestamp,
}

impl Visits {
    /// By the cookie. Without one, the last week is new.
    fn of(headers: &HeaderMap, now: Timestamp) -> Self {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = cookies.flat_map(|list| list.split(';')).filter_map(|pair| pair.trim().split_once('='));
        let times = pairs.find(|(name, _)| *name == VISIT).and_then(|(_, value)| value.split_once('-'));
        let time = |text: &str| Timestamp::from_millisecond(text.parse().ok()?).ok();
        let times = times.and_then(|(before, last)| Some((time(before)?, time(last)?)));
        let before = match times {
            Some((_, last)) if now.duration_since(last) > PAUSE => last,
            Some((before, _)) => before,
            None => now.checked_sub(WEEK).unwrap_or(now),
        };
        Self { before, last: now }
    }

    fn cookie(&self) -> Option<HeaderValue> {
        let prefix = links::prefix();
        let path = if prefix.is_empty() { "/" } else { &*prefix };
        let (before, last) = (self.before.as_millisecond(), self.last.as_millisecond());
        let cookie = format!("{VISIT}={before}-{last}; Path={path}; Max-Age=31536000; HttpOnly; SameSite=Strict");
        HeaderValue::from_str(&cookie).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_visit_ends_after_half_an_hour_without_a_page() {
        let now = Timestamp::from_millisecond(10_000_000_000).expect("a time");
        let before = |cookie: &str| {
            let headers = HeaderMap::from_iter([(header::COOKIE, HeaderValue::from_str(cookie).expect("a header"))]);
            now.as_millisecond() - Visits::of(&headers, now).before.as_millisecond()
        };
        assert_eq!(before("a=b; pinstack_visit=9990000000-9999000000"), 10_000_000, "the visit goes on");
        assert_eq!(before("pinstack_visit=9980000000-9990000000"), 10_000_000, "this is another one");
        for none in ["a=b", "pinstack_visit=x-y", "pinstack_visit=5"] {
            assert_eq!(before(none), WEEK.as_millis() as i64, "{none}");
        }
    }
}
