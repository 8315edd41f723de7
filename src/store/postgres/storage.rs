//! Where the files of this database are. A process with other settings would find no file of any stack, so it is
//! refused.

use anyhow::anyhow;
use uuid::Uuid;

use super::engine::PostgresMetadata;
use crate::store::{
    StoreError, StoreResult,
    rows::transaction::{Lock, Notice},
    s3::S3Url,
};

impl PostgresMetadata {
    /// The id of this store, for a bucket that has its files or is to have them.
    ///
    /// # Errors
    /// When they are elsewhere: in another bucket, or, since there are jobs or uploads already, in a folder.
    pub async fn store_id(&self, bucket: &S3Url) -> StoreResult<Uuid> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let found: Option<(Uuid, Option<String>)> =
            sqlx::query_as("SELECT id, bucket FROM store").fetch_optional(&mut *tx).await?;
        let wanted = bucket.to_string();
        match found {
            Some((id, Some(bucket))) if bucket == wanted => return Ok(id),
            Some((_, Some(bucket))) => return Err(elsewhere(&bucket, &wanted)),
            Some((_, None)) | None => {}
        }
        let has_files = "SELECT EXISTS (SELECT 1 FROM jobs) OR EXISTS (SELECT 1 FROM uploads)";
        if sqlx::query_scalar(has_files).fetch_one(&mut *tx).await? {
            return Err(anyhow!(
                "storage_url: the files of this database are in a folder; move it into the bucket with an empty database \
                 (pinstack backup, then pinstack restore with storage_url)"
            )
            .into());
        }
        let id: Uuid = sqlx::query_scalar(
            "INSERT INTO store (id) VALUES (gen_random_uuid())
             ON CONFLICT (only_row) DO UPDATE SET only_row = true
             RETURNING id",
        )
        .fetch_one(&mut *tx)
        .await?;
        self.commit(tx, "rows.store", Notice::None).await?;
        Ok(id)
    }

    /// Decides that the files are in this bucket, which has taken the id of this store.
    ///
    /// # Errors
    /// When another process has decided for another bucket meanwhile.
    pub async fn store_in_bucket(&self, bucket: &S3Url) -> StoreResult<()> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let wanted = bucket.to_string();
        let decided: String = sqlx::query_scalar("UPDATE store SET bucket = coalesce(bucket, $1) RETURNING bucket")
            .bind(&wanted)
            .fetch_one(&mut *tx)
            .await?;
        if decided != wanted {
            return Err(elsewhere(&decided, &wanted));
        }
        self.commit(tx, "rows.bucket", Notice::None).await
    }

    /// Requires that the files are in a folder.
    ///
    /// # Errors
    /// When they are in a bucket.
    pub async fn store_in_folder(&self) -> StoreResult<()> {
        let bucket: Option<String> =
            sqlx::query_scalar("SELECT bucket FROM store WHERE bucket IS NOT NULL").fetch_optional(&self.pool).await?;
        match bucket {
            Some(bucket) => {
                Err(anyhow!("storage_url is not set, but the files of this database are in {bucket}; set it").into())
            }
            None => Ok(()),
        }
    }
}

fn elsewhere(bucket: &str, wanted: &str) -> StoreError {
    anyhow!("storage_url: the files of this database are in {bucket}, not in {wanted}").into()
}
