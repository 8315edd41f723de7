//! Reads the rows of either engine into structs.
//!
//! sqlx can derive this, but its macro compiles both databases a second time, for the machine that builds: a third of a
//! minute of every clean build.

/// Implements `sqlx::FromRow` for the rows of both engines: `from_row!(Row { column, ... })`, with every field of the
/// struct. `from_row!(Row, inner { column, ... })` reads the field `inner` from columns of the same row.
macro_rules! from_row {
    ($name:ident $(, $inner:ident)? { $($column:ident),+ $(,)? }) => {
        $crate::store::rows::from_row::from_row! { @ sqlx::sqlite::SqliteRow, $name $(, $inner)? { $($column),+ } }
        $crate::store::rows::from_row::from_row! { @ sqlx::postgres::PgRow, $name $(, $inner)? { $($column),+ } }
    };
    (@ $row:ty, $name:ident $(, $inner:ident)? { $($column:ident),+ }) => {
        impl sqlx::FromRow<'_, $row> for $name {
            fn from_row(row: &$row) -> sqlx::Result<Self> {
                use sqlx::Row;
                Ok(Self {
                    $($inner: sqlx::FromRow::from_row(row)?,)?
                    $($column: row.try_get(stringify!($column))?,)+
                })
            }
        }
    };
}

pub(in crate::store) use from_row;
