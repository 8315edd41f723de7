//! The last steps of a request that makes a job: the checked submission and its zip become a job, and the client gets
//! the job.

use axum::{
    Json,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{
    idempotency,
    request::IngestRequest,
    spool::SpooledZip,
    submission::Submission,
    submit::{IncomingZip, Origin, Submitted, ZipFile, submit},
};
use crate::http::{
    ApiResult, App,
    auth::Caller,
    background,
    extract::prefer,
    log,
    views::{JobDocument, job::url},
    waiting::until_final,
};

impl IngestRequest<'_> {
    /// Makes the job. It is made even when the client disconnects: all bytes are here.
    ///
    /// # Errors
    /// `idempotency_key_reused`, and what [`submit`] refuses.
    pub async fn submit(&self, submission: Submission, zip: SpooledZip) -> ApiResult<Submitted> {
        let (app, caller, key) = (self.app.clone(), self.caller.clone(), self.key.stored.clone());
        background::to_the_end(async move { accept(&app, &caller, key, &submission, zip).await }).await
    }

    /// 202 with the job, or 200 when the client sent `Prefer: wait` and the job ended in that time.
    ///
    /// # Errors
    /// When the store cannot be read.
    pub async fn answer(&self, submitted: Submitted) -> ApiResult<Response> {
        let Submitted { job, replayed } = submitted;
        log::note("job", job.id);
        let location = url(&job);
        let wait = prefer::wait(self.headers);
        let job = match wait {
            None => job,
            Some(wait) => until_final(self.app, job.id, wait).await?.unwrap_or(job),
        };
        let has_ended = wait.is_some() && job.state.is_final();
        let status = if has_ended { StatusCode::OK } else { StatusCode::ACCEPTED };
        let mut response = (status, [(header::LOCATION, location)], Json(JobDocument::of(&job))).into_response();
        let out = response.headers_mut();
        if let Some(wait) = wait
            && let Ok(applied) = HeaderValue::from_str(&format!("wait={}", wait.as_secs()))
        {
            out.insert(prefer::PREFERENCE_APPLIED, applied);
        }
        if replayed {
            out.insert(idempotency::IDEMPOTENCY_REPLAYED, HeaderValue::from_static("true"));
        }
        Ok(response)
    }
}

async fn accept(
    app: &App,
    caller: &Caller,
    key: Option<String>,
    submission: &Submission,
    zip: SpooledZip,
) -> ApiResult<Submitted> {
    let fingerprint = idempotency::fingerprint(submission.kind(), submission.fingerprint_input(), &zip.sha256);
    if let Some(key) = &key
        && let Some(job) = idempotency::earlier(app, key, &fingerprint).await?
    {
        return Ok(Submitted { job, replayed: true });
    }
    // the quota is claimed until the store counts the bytes
    let SpooledZip { file, bytes, sha256, filename, quota: _quota } = zip;
    let incoming = IncomingZip {
        id: uuid::Uuid::now_v7(),
        file: ZipFile::Spooled(file),
        bytes,
        sha256,
        filename,
        origin: Origin::Request { owner: caller.id(), idempotency: key.map(|key| (key, fingerprint)) },
    };
    submit(app, submission, incoming).await
}
