//! Resumable uploads.

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use super::{
    clock_gaps::{self, not_expired},
    engine::{Connection, Metadata, dialect},
    jobs, quota,
};
use crate::{
    contract::{Fault, UploadPurpose},
    store::{
        Enqueue, EnqueueAll, NewJob, Page, PageRequest, StoreResult,
        clock::later,
        json,
        rows::{
            JobRow, signed, time,
            transaction::{Lock, Notice},
            unsigned,
            upload::{OpenUploadRow, UploadRow, listed, open_uploads_window},
        },
        uploads::{
            Advance, CreateUpload, ExpiredUpload, NewUpload, OpenUpload, OpenUploadLimits, PartialUpload, UploadRecords,
        },
    },
};

#[async_trait]
impl UploadRecords for Metadata {
    async fn create_upload(&self, upload: &NewUpload, limits: OpenUploadLimits) -> StoreResult<CreateUpload> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let now = self.now(&mut *tx).await?;
        let (open, of_owner): (i64, i64) = sqlx::query_as(concat!(
            "SELECT count(*), count(*) FILTER (WHERE owner = $2) FROM uploads
             WHERE job_kind IS NULL AND fault IS NULL AND ",
            not_expired!("$1")
        ))
        .bind(now)
        .bind(upload.owner)
        .fetch_one(&mut *tx)
        .await?;
        if unsigned(open) >= limits.all {
            return Ok(CreateUpload::TooMany { of_owner: false });
        }
        if unsigned(of_owner) >= limits.of_owner {
            return Ok(CreateUpload::TooMany { of_owner: true });
        }
        if let Some(over) = quota::exceeded(&mut tx, upload.owner, upload.length, now).await? {
            return Ok(CreateUpload::OverQuota(over));
        }
        let row: UploadRow = sqlx::query_as(
            "INSERT INTO uploads (id, length, received, digest, metadata, wanted, created_at, expires_at, owner)
             VALUES ($1, $2, 0, $3, $4, 0, $5, $6, $7)
             RETURNING *",
        )
        .bind(upload.id)
        .bind(signed(upload.length))
        .bind(&upload.digest)
        .bind(&upload.metadata)
        .bind(now)
        .bind(later(now, upload.keep))
        .bind(upload.owner)
        .fetch_one(&mut *tx)
        .await?;
        self.commit(tx, "rows.create_upload", Notice::None).await?;
        Ok(CreateUpload::Created(row.try_into()?))
    }

    async fn list_open_uploads(&self, page: &PageRequest) -> StoreResult<Page<OpenUpload>> {
        let (before, limit) = open_uploads_window(page)?;
        let now = self.now(self.reading()).await?;
        let rows: Vec<OpenUploadRow> = sqlx::query_as(concat!(
            "SELECT uploads.*, tokens.name AS token FROM uploads LEFT JOIN tokens ON tokens.id = uploads.owner
             WHERE uploads.id < $1 AND job_kind IS NULL AND fault IS NULL AND ",
            not_expired!("$2"),
            "
             ORDER BY uploads.id DESC LIMIT $3"
        ))
        .bind(before)
        .bind(now)
        .bind(limit)
        .fetch_all(self.reading())
        .await?;
        Ok(listed(rows, limit))
    }

    async fn upload(&self, id: Uuid) -> StoreResult<Option<PartialUpload>> {
        let now = self.now(self.reading()).await?;
        let row: Option<UploadRow> =
            sqlx::query_as(concat!("SELECT * FROM uploads WHERE id = $1 AND ", not_expired!("$2")))
                .bind(id)
                .bind(now)
                .fetch_optional(self.reading())
                .await?;
        row.map(PartialUpload::try_from).transpose()
    }

    async fn take_over_upload(&self, id: Uuid) -> StoreResult<Option<i64>> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let now = self.now(&mut *tx).await?;
            let generation: Option<i64> = sqlx::query_scalar(concat!(
                "UPDATE uploads SET wanted = wanted + 1 WHERE id = $1 AND ",
                not_expired!("$2"),
                " RETURNING wanted"
            ))
            .bind(id)
            .bind(now)
            .fetch_optional(&mut *tx)
            .await?;
            self.commit(tx, "rows.want_upload", Notice::Changes(&[id])).await?;
            Ok(generation)
        })
        .await
    }

    async fn advance_upload(&self, id: Uuid, advance: &Advance) -> StoreResult<bool> {
        let mut tx = self.write().await?;
        let now = self.now(&mut *tx).await?;
        let advanced = sqlx::query(
            "UPDATE uploads SET received = $3, digest = $4, expires_at = $5, last_byte_at = $6
             WHERE id = $1 AND received = $2 AND job_kind IS NULL AND fault IS NULL
               AND wanted = coalesce($7, wanted)",
        )
        .bind(id)
        .bind(signed(advance.from))
        .bind(signed(advance.to))
        .bind(&advance.digest)
        .bind(later(now, advance.keep))
        .bind(now)
        .bind(advance.generation)
        .execute(&mut *tx)
        .await?;
        self.commit(tx, "rows.advance_upload", Notice::None).await?;
        Ok(advanced.rows_affected() == 1)
    }

    async fn complete_upload(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Option<Enqueue>> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let sender = match completion_of(&mut tx, job.id).await? {
            Completion::Impossible => return Ok(None),
            Completion::Done => {
                let row: Option<JobRow> =
                    sqlx::query_as("SELECT * FROM jobs WHERE id = $1").bind(job.id).fetch_optional(&mut *tx).await?;
                let job = row.map(TryInto::try_into).transpose()?;
                return Ok(job.map(|job| Enqueue::Repeated(Box::new(job))));
            }
            Completion::Due(sender) => sender,
        };
        let enqueued = jobs::insert(self, &mut tx, job, sender, queue_limit).await?;
        if let Enqueue::Accepted(_) = &enqueued {
            record_purpose(&mut tx, job.id, job.request.kind().as_str()).await?;
            own_by_upload(&mut tx, job.id, job.id).await?;
            self.commit(tx, "rows.complete_upload", Notice::Arrivals(&[job.id])).await?;
        }
        Ok(Some(enqueued))
    }

    async fn complete_scan_upload(
        &self,
        id: Uuid,
        jobs: &[NewJob],
        queue_limit: u64,
    ) -> StoreResult<Option<EnqueueAll>> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let sender = match completion_of(&mut tx, id).await? {
            Completion::Impossible => return Ok(None),
            Completion::Done => return Ok(Some(EnqueueAll::Accepted(Vec::new()))),
            Completion::Due(sender) => sender,
        };
        let enqueued = jobs::insert_all(self, &mut tx, jobs, sender, queue_limit).await?;
        if let EnqueueAll::Accepted(accepted) = &enqueued {
            record_purpose(&mut tx, id, UploadPurpose::Scan.as_str()).await?;
            for job in accepted {
                own_by_upload(&mut tx, job.id, id).await?;
            }
            let ids: Vec<Uuid> = jobs.iter().map(|job| job.id).chain([id]).collect();
            self.commit(tx, "rows.complete_scan_upload", Notice::Arrivals(&ids)).await?;
        }
        Ok(Some(enqueued))
    }

    async fn refuse_upload(&self, id: Uuid, fault: &Fault) -> StoreResult<bool> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let refused = sqlx::query("UPDATE uploads SET fault = $2 WHERE id = $1 AND job_kind IS NULL")
                .bind(id)
                .bind(json::stored::<Fault>("the refusal of an upload", fault)?)
                .execute(&mut *tx)
                .await?;
            self.commit(tx, "rows.refuse_upload", Notice::None).await?;
            Ok(refused.rows_affected() == 1)
        })
        .await
    }

    async fn delete_upload(&self, id: Uuid) -> StoreResult<bool> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let deleted = sqlx::query("DELETE FROM uploads WHERE id = $1").bind(id).execute(&mut *tx).await?;
            self.commit(tx, "rows.delete_upload", Notice::Changes(&[id])).await?;
            Ok(deleted.rows_affected() == 1)
        })
        .await
    }

    async fn delete_expired_uploads(&self) -> StoreResult<Vec<ExpiredUpload>> {
        self.freeing(|| async {
            clock_gaps::observe(self).await?;
            let mut tx = self.write_alone(Lock::Expiry).await?;
            let now = self.now(&mut *tx).await?;
            let gone: Vec<(Uuid, bool)> = sqlx::query_as(concat!(
                "DELETE FROM uploads WHERE NOT (",
                not_expired!("$1"),
                ") RETURNING id, job_kind IS NULL AND fault IS NULL"
            ))
            .bind(now)
            .fetch_all(&mut *tx)
            .await?;
            self.commit(tx, "rows.expire_uploads", Notice::None).await?;
            Ok(gone.into_iter().map(|(id, was_open)| ExpiredUpload { id, was_open }).collect())
        })
        .await
    }

    async fn upload_is_open(&self, id: Uuid) -> StoreResult<bool> {
        let open = "SELECT EXISTS (SELECT 1 FROM uploads WHERE id = $1 AND job_kind IS NULL AND fault IS NULL)";
        Ok(sqlx::query_scalar(open).bind(id).fetch_one(self.reading()).await?)
    }

    async fn storing_since(&self) -> StoreResult<Option<Timestamp>> {
        let since: Option<i64> = sqlx::query_scalar(
            "SELECT MIN(COALESCE(last_byte_at, created_at)) FROM uploads
             WHERE job_kind IS NULL AND fault IS NULL AND received = length",
        )
        .fetch_one(self.reading())
        .await?;
        since.map(time).transpose()
    }

    async fn open_uploads(&self) -> StoreResult<Vec<Uuid>> {
        Ok(sqlx::query_scalar("SELECT id FROM uploads WHERE job_kind IS NULL AND fault IS NULL ORDER BY id")
            .fetch_all(self.reading())
            .await?)
    }

    async fn reserved_bytes(&self) -> StoreResult<u64> {
        let now = self.now(self.reading()).await?;
        let bytes: i64 = sqlx::query_scalar(concat!(
            "SELECT CAST(COALESCE(SUM(length - received), 0) AS bigint) FROM uploads
             WHERE job_kind IS NULL AND fault IS NULL AND ",
            not_expired!("$1")
        ))
        .bind(now)
        .fetch_one(self.reading())
        .await?;
        Ok(unsigned(bytes))
    }
}

/// What a request that completes an upload finds.
enum Completion {
    /// Bytes are missing, it was refused, or there is no such upload.
    Impossible,
    /// Its job, or its stacks, exist.
    Done,
    /// The jobs can be made. The token that sent the upload.
    Due(Option<Uuid>),
}

/// Locks the row of an upload that is to become jobs.
async fn completion_of(connection: &mut Connection, id: Uuid) -> StoreResult<Completion> {
    let row = sqlx::query_as(concat!(
        "SELECT job_kind, fault, owner FROM uploads WHERE id = $1 AND received = length",
        dialect!(FOR UPDATE)
    ));
    let row: Option<(Option<String>, Option<String>, Option<Uuid>)> = row.bind(id).fetch_optional(connection).await?;
    Ok(match row {
        None | Some((_, Some(_), _)) => Completion::Impossible,
        Some((Some(_), None, _)) => Completion::Done,
        Some((None, None, sender)) => Completion::Due(sender),
    })
}

/// Records what an upload has become.
async fn record_purpose(connection: &mut Connection, id: Uuid, purpose: &str) -> StoreResult<()> {
    sqlx::query("UPDATE uploads SET job_kind = $2 WHERE id = $1").bind(id).bind(purpose).execute(connection).await?;
    Ok(())
}

/// Gives a job to the token that created the upload, whichever token completed it.
async fn own_by_upload(connection: &mut Connection, job: Uuid, upload: Uuid) -> StoreResult<()> {
    sqlx::query("UPDATE jobs SET owner = (SELECT owner FROM uploads WHERE id = $2) WHERE id = $1")
        .bind(job)
        .bind(upload)
        .execute(connection)
        .await?;
    Ok(())
}
