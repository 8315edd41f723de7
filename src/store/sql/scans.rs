//! Scans.

use async_trait::async_trait;
use uuid::Uuid;

use super::engine::{Connection, Metadata};
use crate::{
    contract::{Name, Scan, ScanInput, scan::Reconstruct},
    store::{
        Page, PageRequest, Precondition, StoreResult, json,
        rows::{
            name,
            page::Window,
            scan::{ScanRow, listed},
            transaction::{Lock, Notice},
            unsigned,
        },
        scans::{DeleteScan, PutScan, ScanFilter, ScanStore, SettledScan},
    },
};

#[async_trait]
impl ScanStore for Metadata {
    async fn put_scan(
        &self,
        name: &Name,
        input: &ScanInput,
        owner: Option<Uuid>,
        condition: Precondition,
    ) -> StoreResult<PutScan> {
        let mut tx = self.write_alone(Lock::Accept).await?;
        let current: Option<(i64, String, String)> =
            sqlx::query_as("SELECT version, rig, lens FROM scans WHERE name = $1")
                .bind(name.as_str())
                .fetch_optional(&mut *tx)
                .await?;
        let version = current.as_ref().and_then(|(version, ..)| u32::try_from(*version).ok());
        if !condition.holds(version) {
            return Ok(PutScan::PreconditionFailed(version));
        }
        if let Some((_, rig, lens)) = &current
            && (rig, lens) != (&input.rig.to_string(), &input.lens.to_string())
        {
            let stacks = stacks(&mut tx, name).await?;
            if stacks > 0 {
                return Ok(PutScan::HasStacks(stacks));
            }
        }
        let now = self.now(&mut *tx).await?;
        let row: ScanRow = sqlx::query_as(
            "INSERT INTO scans (name, rig, lens, body, version, owner, created_at, updated_at, reconstructs)
             VALUES ($1, $2, $3, $4, 1, $5, $6, $6, $7)
             ON CONFLICT (name) DO UPDATE
             SET rig = $2, lens = $3, body = $4, version = scans.version + 1, updated_at = $6, reconstructs = $7
             RETURNING *",
        )
        .bind(name.as_str())
        .bind(input.rig.as_str())
        .bind(input.lens.as_str())
        .bind(json::stored::<ScanInput>("a scan", input)?)
        .bind(owner)
        .bind(now)
        .bind(input.reconstruct == Reconstruct::Auto)
        .fetch_one(&mut *tx)
        .await?;
        self.commit(tx, "rows.put_scan", Notice::None).await?;
        let scan = row.try_into()?;
        Ok(if current.is_none() { PutScan::Created(scan) } else { PutScan::Updated(scan) })
    }

    async fn scan(&self, name: &Name) -> StoreResult<Option<Scan>> {
        let row: Option<ScanRow> = sqlx::query_as("SELECT * FROM scans WHERE name = $1")
            .bind(name.as_str())
            .fetch_optional(self.reading())
            .await?;
        row.map(Scan::try_from).transpose()
    }

    async fn scan_owner(&self, name: &Name) -> StoreResult<Option<Uuid>> {
        let owner: Option<Option<Uuid>> = sqlx::query_scalar("SELECT owner FROM scans WHERE name = $1")
            .bind(name.as_str())
            .fetch_optional(self.reading())
            .await?;
        Ok(owner.flatten())
    }

    async fn scans(&self, filter: &ScanFilter, page: &PageRequest) -> StoreResult<Page<Scan>> {
        let window = Window::of("scans", page)?;
        let rows = sqlx::query_as(
            "SELECT * FROM scans
             WHERE seq < $1 AND ($2 IS NULL OR rig = $2) AND ($3 IS NULL OR lens = $3)
               AND ($4 IS NULL OR owner IS NULL OR owner = $4)
             ORDER BY seq DESC LIMIT $5",
        )
        .bind(window.before)
        .bind(filter.rig.as_ref().map(Name::as_str))
        .bind(filter.lens.as_ref().map(Name::as_str))
        .bind(filter.owner)
        .bind(window.rows)
        .fetch(self.reading());
        let (rows, next_cursor) = window.fill(rows, |row: &ScanRow| (row.seq, row.body.len())).await?;
        Ok(listed(rows, next_cursor))
    }

    async fn scan_names(&self, owner: Option<Uuid>, limit: u32) -> StoreResult<Vec<Name>> {
        let names: Vec<String> = sqlx::query_scalar(
            "SELECT name FROM scans WHERE $1 IS NULL OR owner IS NULL OR owner = $1 ORDER BY seq DESC LIMIT $2",
        )
        .bind(owner)
        .bind(i64::from(limit))
        .fetch_all(self.reading())
        .await?;
        names.into_iter().map(name).collect()
    }

    async fn settled_scans(&self) -> StoreResult<Vec<SettledScan>> {
        let rows: Vec<(String, Option<Uuid>, String)> = sqlx::query_as(
            "SELECT name, owner, state FROM (
                 SELECT name, owner, examined, CAST(version AS text) || ' ' || (
                     SELECT CAST(count(*) AS text) || ' ' || CAST(COALESCE(sum(seq), 0) AS text) || ' '
                            || CAST(COALESCE(max(finished_at), 0) AS text)
                     FROM jobs WHERE scan = scans.name AND kind = 'stack' AND state = 'succeeded') AS state
                 FROM scans
                 WHERE reconstructs AND NOT EXISTS (
                     SELECT 1 FROM jobs WHERE scan = scans.name AND kind = 'stack' AND state IN ('queued', 'running'))
             ) AS settled
             WHERE examined IS NULL OR examined <> state LIMIT 100",
        )
        .fetch_all(self.reading())
        .await?;
        let settled = |(of, owner, state)| Ok(SettledScan { name: name(of)?, owner, state });
        rows.into_iter().map(settled).collect()
    }

    async fn scan_examined(&self, scan: &SettledScan) -> StoreResult<()> {
        let mut tx = self.write().await?;
        sqlx::query("UPDATE scans SET examined = $2 WHERE name = $1")
            .bind(scan.name.as_str())
            .bind(&scan.state)
            .execute(&mut *tx)
            .await?;
        self.commit(tx, "rows.scan_examined", Notice::None).await
    }

    async fn delete_scan(&self, name: &Name, condition: Precondition) -> StoreResult<DeleteScan> {
        self.freeing(|| async {
            let mut tx = self.write_alone(Lock::Accept).await?;
            let version: Option<i64> = sqlx::query_scalar("SELECT version FROM scans WHERE name = $1")
                .bind(name.as_str())
                .fetch_optional(&mut *tx)
                .await?;
            let version = version.and_then(|version| u32::try_from(version).ok());
            if !condition.holds(version) {
                return Ok(DeleteScan::PreconditionFailed(version));
            }
            if version.is_none() {
                return Ok(DeleteScan::NotFound);
            }
            let stacks = stacks(&mut tx, name).await?;
            if stacks > 0 {
                return Ok(DeleteScan::HasStacks(stacks));
            }
            sqlx::query("DELETE FROM scans WHERE name = $1").bind(name.as_str()).execute(&mut *tx).await?;
            self.commit(tx, "rows.delete_scan", Notice::None).await?;
            Ok(DeleteScan::Deleted)
        })
        .await
    }
}

/// True when a scan of this name, rig and lens exists: a stack may join it.
pub(super) async fn accepts(connection: &mut Connection, scan: &Name, rig: &Name, lens: &Name) -> StoreResult<bool> {
    let found = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM scans WHERE name = $1 AND rig = $2 AND lens = $3)");
    Ok(found.bind(scan.as_str()).bind(rig.as_str()).bind(lens.as_str()).fetch_one(connection).await?)
}

/// Number of stacks of a scan.
async fn stacks(connection: &mut Connection, scan: &Name) -> StoreResult<u64> {
    let count: i64 =
        sqlx::query_scalar("SELECT count(*) FROM jobs WHERE scan = $1 AND kind = 'stack' AND NOT delete_requested")
            .bind(scan.as_str())
            .fetch_one(connection)
            .await?;
    Ok(unsigned(count))
}
