//! A table as CSV or Parquet. Columns may lack values; numbers that are not finite are `nan`, `inf` and `-inf` in CSV, as
//! everywhere in the API, and plain doubles in Parquet.

use super::ApiError;
use axum::{
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical},
    data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type},
    file::{properties::WriterProperties, writer::SerializedFileWriter},
    schema::types::Type,
};
use schemars::JsonSchema;
use serde::Deserialize;
use std::{fmt::Write as _, sync::Arc};

/// In which form.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// JSON.
    Json,
    /// Comma-separated, with a header.
    Csv,
    /// Apache Parquet, Snappy.
    Parquet,
}

impl Format {
    /// What the query asks for, else the header `accept`.
    pub fn of(asked: Option<Self>, headers: &HeaderMap) -> Self {
        let accepted = headers
            .get(header::ACCEPT)
            .and_then(|value| value.to_str().ok())
            .unwrap_or_default();
        asked.unwrap_or(match accepted {
            accepted if accepted.contains("text/csv") => Self::Csv,
            accepted if accepted.contains("application/vnd.apache.parquet") => Self::Parquet,
            _ => Self::Json,
        })
    }
}

/// The values of a column.
pub enum Column {
    /// Whole numbers.
    Integers(Vec<Option<i64>>),
    /// Numbers.
    Numbers(Vec<Option<f64>>),
    /// Flags.
    Flags(Vec<bool>),
    /// Text.
    Texts(Vec<Option<String>>),
    /// Milliseconds since 1970; RFC 3339 in CSV.
    Times(Vec<crate::store::Timestamp>),
}

/// Named columns of equal length.
#[derive(Default)]
pub struct Table {
    columns: Vec<(String, Column)>,
    n_rows: usize,
}

impl Table {
    /// Adds a column.
    pub fn with(mut self, name: impl Into<String>, column: Column) -> Self {
        self.n_rows = column.len();
        self.columns.push((name.into(), column));
        self
    }

    /// The answer in a form that is not JSON.
    pub fn respond(&self, format: Format, name: &str) -> Result<Response, ApiError> {
        let (media_type, extension, bytes) = match format {
            Format::Parquet => (
                "application/vnd.apache.parquet",
                "parquet",
                self.parquet().map_err(ApiError::internal)?,
            ),
            _ => ("text/csv; charset=utf-8", "csv", self.csv().into_bytes()),
        };
        let disposition = format!("inline; filename=\"{name}.{extension}\"");
        let headers = [
            (header::CONTENT_TYPE, media_type.to_owned()),
            (header::CONTENT_DISPOSITION, disposition),
        ];
        Ok((headers, bytes).into_response())
    }

    /// A header, then a row a line.
    pub fn csv(&self) -> String {
        let mut text = String::new();
        for (i, (name, _)) in self.columns.iter().enumerate() {
            let _ = write!(text, "{}{}", if i > 0 { "," } else { "" }, quoted(name));
        }
        text.push('\n');
        for row in 0..self.n_rows {
            for (i, (_, column)) in self.columns.iter().enumerate() {
                if i > 0 {
                    text.push(',');
                }
                column.write(row, &mut text);
            }
            text.push('\n');
        }
        text
    }

    fn parquet(&self) -> Result<Vec<u8>, parquet::errors::ParquetError> {
        let fields = self
            .columns
            .iter()
            .map(|(name, column)| column.field(name))
            .collect::<Result<_, _>>()?;
        let schema = Type::group_type_builder("schema").with_fields(fields).build()?;
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let mut file = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
        let mut rows = file.next_row_group()?;
        for (_, column) in &self.columns {
            let mut writer = rows.next_column()?.expect("as many columns as fields");
            match column {
                Column::Integers(values) => optional::<Int64Type, _>(&mut writer, values, |value| *value)?,
                Column::Numbers(values) => optional::<DoubleType, _>(&mut writer, values, |value| *value)?,
                Column::Texts(values) => {
                    optional::<ByteArrayType, _>(&mut writer, values, |text| ByteArray::from(text.as_str()))?;
                }
                Column::Flags(values) => drop(writer.typed::<BoolType>().write_batch(values, None, None)?),
                Column::Times(values) => {
                    let ms: Vec<i64> = values.iter().map(|time| time.0).collect();
                    writer.typed::<Int64Type>().write_batch(&ms, None, None)?;
                }
            }
            writer.close()?;
        }
        rows.close()?;
        file.into_inner()
    }
}

/// Writes what is there, and where something is missing.
fn optional<T: parquet::data_type::DataType, V>(
    writer: &mut parquet::file::writer::SerializedColumnWriter<'_>,
    values: &[Option<V>],
    convert: impl Fn(&V) -> T::T,
) -> Result<(), parquet::errors::ParquetError> {
    let levels: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
    let present: Vec<T::T> = values.iter().flatten().map(convert).collect();
    writer.typed::<T>().write_batch(&present, Some(&levels), None)?;
    Ok(())
}

impl Column {
    fn len(&self) -> usize {
        match self {
            Self::Integers(values) => values.len(),
            Self::Numbers(values) => values.len(),
            Self::Flags(values) => values.len(),
            Self::Texts(values) => values.len(),
            Self::Times(values) => values.len(),
        }
    }

    fn write(&self, row: usize, text: &mut String) {
        let _ = match self {
            Self::Integers(values) => values[row].map_or(Ok(()), |value| write!(text, "{value}")),
            // Rust writes `inf`, `-inf` and `NaN`; the API's names are lower case throughout.
            Self::Numbers(values) => {
                values[row].map_or(Ok(()), |value| text.write_str(&value.to_string().to_lowercase()))
            }
            Self::Flags(values) => write!(text, "{}", values[row]),
            Self::Texts(values) => text.write_str(&values[row].as_deref().map(quoted).unwrap_or_default()),
            Self::Times(values) => write!(text, "{}", values[row]),
        };
    }

    fn field(&self, name: &str) -> Result<Arc<Type>, parquet::errors::ParquetError> {
        let (physical, logical, repetition) = match self {
            Self::Integers(_) => (Physical::INT64, None, Repetition::OPTIONAL),
            Self::Numbers(_) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
            Self::Flags(_) => (Physical::BOOLEAN, None, Repetition::REQUIRED),
            Self::Texts(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::OPTIONAL),
            Self::Times(_) => (Physical::INT64, None, Repetition::REQUIRED),
        };
        let field = Type::primitive_type_builder(name, physical)
            .with_logical_type(logical)
            .with_repetition(repetition);
        Ok(Arc::new(field.build()?))
    }
}

/// Quoted where it has to be.
fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::{
        file::reader::{FileReader as _, SerializedFileReader},
        record::RowAccessor as _,
    };

    fn table() -> Table {
        Table::default()
            .with("frame", Column::Integers(vec![Some(0), Some(1)]))
            .with("reset", Column::Flags(vec![true, false]))
            .with("psnr", Column::Numbers(vec![Some(f64::INFINITY), None]))
            .with("commit", Column::Texts(vec![Some("a,\"b\"".to_owned()), None]))
    }

    #[test]
    fn csv_quotes_and_leaves_out() {
        assert_eq!(
            table().csv(),
            "frame,reset,psnr,commit\n0,true,inf,\"a,\"\"b\"\"\"\n1,false,,\n"
        );
    }

    #[test]
    fn parquet_comes_back() {
        let bytes = table().parquet().unwrap();
        let reader = SerializedFileReader::new(axum::body::Bytes::from(bytes)).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().collect::<Result<_, _>>().unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!(
            (rows[0].get_long(0).unwrap(), rows[0].get_double(2).unwrap()),
            (0, f64::INFINITY)
        );
        assert_eq!(rows[0].get_string(3).unwrap(), "a,\"b\"");
        assert!(rows[1].get_double(2).is_err(), "a null");
    }
}
