//! Parquet tables: a handful of typed, nullable columns, written in one row group.

use super::Error;
use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::RowAccessor;
use parquet::schema::types::Type;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Values of one column; `None` is null.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// UTF-8 text.
    Text(Vec<Option<String>>),
    /// 64-bit integers.
    Integer(Vec<Option<i64>>),
    /// 64-bit floats.
    Float(Vec<Option<f64>>),
    /// Truth values.
    Boolean(Vec<Option<bool>>),
}

/// A table under construction: columns in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    columns: Vec<(String, Values)>,
}

impl Table {
    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a column of text.
    pub fn text<S: Into<String>>(&mut self, name: &str, values: impl IntoIterator<Item = Option<S>>) {
        let values = values.into_iter().map(|v| v.map(Into::into)).collect();
        self.columns.push((name.to_owned(), Values::Text(values)));
    }

    /// Adds a column of integers.
    pub fn integer(&mut self, name: &str, values: impl IntoIterator<Item = Option<i64>>) {
        self.columns.push((name.to_owned(), Values::Integer(values.into_iter().collect())));
    }

    /// Adds a column of floats.
    pub fn float(&mut self, name: &str, values: impl IntoIterator<Item = Option<f64>>) {
        self.columns.push((name.to_owned(), Values::Float(values.into_iter().collect())));
    }

    /// Adds a column of truth values.
    pub fn boolean(&mut self, name: &str, values: impl IntoIterator<Item = Option<bool>>) {
        self.columns.push((name.to_owned(), Values::Boolean(values.into_iter().collect())));
    }

    /// The table as a Parquet file. Equal tables give equal bytes.
    pub fn to_parquet(&self) -> Result<Vec<u8>, Error> {
        self.write().map_err(|e| Error::Encode { what: "Parquet table", why: e.to_string() })
    }

    fn write(&self) -> parquet::errors::Result<Vec<u8>> {
        let fields = self.columns.iter().map(|(name, values)| {
            let (physical, logical) = match values {
                Values::Text(_) => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
                Values::Integer(_) => (PhysicalType::INT64, None),
                Values::Float(_) => (PhysicalType::DOUBLE, None),
                Values::Boolean(_) => (PhysicalType::BOOLEAN, None),
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical);
            field.build().map(Arc::new)
        });
        let fields = fields.collect::<parquet::errors::Result<Vec<_>>>()?;
        let schema = Arc::new(Type::group_type_builder("row").with_fields(fields).build()?);
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_created_by(concat!("twinrig ", env!("CARGO_PKG_VERSION")).to_owned())
            .build();
        let mut bytes = Vec::new();
        let mut file = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties))?;
        let mut group = file.next_row_group()?;
        for (_, values) in &self.columns {
            let mut column = group.next_column()?.expect("the schema has one leaf for each column");
            match values {
                Values::Text(v) => {
                    let (present, levels) = present(v, |s| ByteArray::from(s.as_str()));
                    column.typed::<ByteArrayType>().write_batch(&present, Some(&levels), None)?;
                }
                Values::Integer(v) => {
                    let (present, levels) = present(v, |x| *x);
                    column.typed::<Int64Type>().write_batch(&present, Some(&levels), None)?;
                }
                Values::Float(v) => {
                    let (present, levels) = present(v, |x| *x);
                    column.typed::<DoubleType>().write_batch(&present, Some(&levels), None)?;
                }
                Values::Boolean(v) => {
                    let (present, levels) = present(v, |x| *x);
                    column.typed::<BoolType>().write_batch(&present, Some(&levels), None)?;
                }
            }
            column.close()?;
        }
        group.close()?;
        file.close()?;
        Ok(bytes)
    }
}

/// The values that are there, and a definition level (1 = there) for each row.
fn present<T, U>(values: &[Option<T>], convert: impl Fn(&T) -> U) -> (Vec<U>, Vec<i16>) {
    let levels = values.iter().map(|v| i16::from(v.is_some())).collect();
    (values.iter().flatten().map(convert).collect(), levels)
}

/// Reads columns of a table back: texts by integer key, for verification.
pub fn read_text_by_key(
    bytes: Vec<u8>,
    key: &str,
    texts: &[&str],
) -> Result<BTreeMap<i64, Vec<Option<String>>>, String> {
    let reader = SerializedFileReader::new(bytes::Bytes::from(bytes)).map_err(|e| e.to_string())?;
    let schema = reader.metadata().file_metadata().schema_descr();
    let position = |name: &str| {
        let found = schema.columns().iter().position(|c| c.name() == name);
        found.ok_or_else(|| format!("no column {name}"))
    };
    let key_at = position(key)?;
    let texts_at = texts.iter().map(|text| position(text)).collect::<Result<Vec<_>, _>>()?;
    let mut found = BTreeMap::new();
    for row in reader.get_row_iter(None).map_err(|e| e.to_string())? {
        let row = row.map_err(|e| e.to_string())?;
        let values = texts_at.iter().map(|at| row.get_string(*at).ok().cloned()).collect();
        found.insert(row.get_long(key_at).map_err(|e| e.to_string())?, values);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nulls_and_values_come_back() {
        let mut table = Table::new();
        table.integer("capture", [Some(0), Some(7)]);
        table.text("real_file_name", [Some("real/000000.png"), None]);
        table.float("x", [None, Some(f64::INFINITY)]);
        table.boolean("b", [Some(true), None]);
        let bytes = table.to_parquet().expect("writes");
        assert_eq!(bytes, table.to_parquet().expect("writes again"), "deterministic");
        let back = read_text_by_key(bytes, "capture", &["real_file_name"]).expect("reads");
        assert_eq!(back[&0], [Some("real/000000.png".to_owned())]);
        assert_eq!(back[&7], [None]);
    }
}
