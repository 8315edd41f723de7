//! Tokens.

use async_trait::async_trait;
use uuid::Uuid;

use super::{engine::Metadata, quota};
use crate::{
    contract::Name,
    store::{
        StoreResult,
        rows::{signed, token::TokenRow, transaction::Notice, unsigned},
        tokens::{NewToken, Token, Tokens, names},
    },
};

#[async_trait]
impl Tokens for Metadata {
    async fn add_token(&self, token: &NewToken) -> StoreResult<bool> {
        let mut tx = self.write().await?;
        let now = self.now(&mut *tx).await?;
        let added = sqlx::query(
            "INSERT INTO tokens (id, name, digest, scopes, created_at, quota_bytes) VALUES ($1, $2, $3, $4, $5, $6)
             ON CONFLICT (name) DO NOTHING",
        )
        .bind(token.id)
        .bind(token.name.as_str())
        .bind(token.digest.as_slice())
        .bind(names(&token.scopes, " "))
        .bind(now)
        .bind(token.quota_bytes.map(signed))
        .execute(&mut *tx)
        .await?;
        self.commit(tx, "rows.add_token", Notice::None).await?;
        Ok(added.rows_affected() == 1)
    }

    async fn token(&self, id: Uuid) -> StoreResult<Option<Token>> {
        let row: Option<TokenRow> =
            sqlx::query_as("SELECT * FROM tokens WHERE id = $1").bind(id).fetch_optional(self.reading()).await?;
        row.map(Token::try_from).transpose()
    }

    async fn tokens(&self) -> StoreResult<Vec<Token>> {
        let rows: Vec<TokenRow> =
            sqlx::query_as("SELECT * FROM tokens ORDER BY created_at, id").fetch_all(self.reading()).await?;
        rows.into_iter().map(Token::try_from).collect()
    }

    async fn any_token(&self) -> StoreResult<bool> {
        Ok(sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM tokens)").fetch_one(self.reading()).await?)
    }

    async fn revoke_token(&self, name: &Name) -> StoreResult<bool> {
        self.freeing(|| async {
            let mut tx = self.write().await?;
            let now = self.now(&mut *tx).await?;
            let revoked = sqlx::query("UPDATE tokens SET revoked_at = $2 WHERE name = $1 AND revoked_at IS NULL")
                .bind(name.as_str())
                .bind(now)
                .execute(&mut *tx)
                .await?;
            self.commit(tx, "rows.revoke_token", Notice::None).await?;
            Ok(revoked.rows_affected() == 1)
        })
        .await
    }

    async fn owner(&self, id: Uuid) -> StoreResult<Option<Uuid>> {
        let owner: Option<Option<Uuid>> = sqlx::query_scalar(
            "SELECT owner FROM jobs WHERE id = $1 UNION ALL SELECT owner FROM uploads WHERE id = $1 LIMIT 1",
        )
        .bind(id)
        .fetch_optional(self.reading())
        .await?;
        Ok(owner.flatten())
    }

    async fn used_bytes(&self, owner: Uuid) -> StoreResult<u64> {
        let now = self.now(self.reading()).await?;
        Ok(unsigned(quota::used_bytes(self.reading(), owner, now).await?))
    }
}
