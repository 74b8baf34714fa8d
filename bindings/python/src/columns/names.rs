//! Columns of texts that repeat.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, DictionaryArray, Int32Array, StringArray};
use arrow_schema::ArrowError;
use cobscope_decoder::sink::escape;

use super::numbers::{NumberColumn, NumberParts};

/// Number of a text in [`NameColumn`].
pub type Key = i32;

/// Texts that repeat. All batches of a table share one dictionary, which grows.
#[derive(Default)]
pub struct NameColumn {
    keys: NumberColumn<Key>,
    numbers: HashMap<Box<str>, Key>,
    texts: Vec<Box<str>>,
    array: Option<ArrayRef>,
    /// Memory of batches with one text.
    equal: Option<(Option<Key>, NumberParts<Key>)>,
}

impl NameColumn {
    /// Number of a text, which is escaped.
    pub fn text_key(&mut self, text: &str) -> Key {
        if let Some(key) = self.numbers.get(text) {
            return *key;
        }
        let key = Key::try_from(self.texts.len()).unwrap_or(Key::MAX);
        self.numbers.insert(text.into(), key);
        self.texts.push(escape(text).into());
        self.array = None;
        key
    }

    /// Number of different texts.
    pub fn size(&self) -> usize {
        self.texts.len()
    }

    /// Forgets all texts and their numbers; only directly after [`Self::take_rows`].
    pub fn forget_texts(&mut self) {
        (self.numbers, self.texts, self.array, self.equal) = (HashMap::new(), Vec::new(), None, None);
    }

    /// Adds a row with a number of [`Self::text_key`].
    #[inline]
    pub fn push_key(&mut self, key: Option<Key>) {
        self.keys.push(key);
    }

    /// Adds a row.
    pub fn push(&mut self, text: Option<&str>) {
        let key = text.map(|text| self.text_key(text));
        self.keys.push(key);
    }

    /// The rows so far.
    ///
    /// # Errors
    /// If there are more texts than numbers for them.
    pub fn take_rows(&mut self) -> Result<ArrayRef, ArrowError> {
        let keys = self.keys.take_parts();
        self.array_of(keys)
    }

    /// Rows with numbers of [`Self::text_key`], in place of rows that were added.
    ///
    /// # Errors
    /// If there are more texts than numbers for them.
    pub fn array_of(&mut self, keys: NumberParts<Key>) -> Result<ArrayRef, ArrowError> {
        dictionary_array(keys, &self.all_texts())
    }

    /// All texts, in the order of their numbers.
    pub fn all_texts(&mut self) -> ArrayRef {
        let texts = &self.texts;
        let array = self.array.get_or_insert_with(|| Arc::new(StringArray::from_iter_values(texts)));
        Arc::clone(array)
    }

    /// Numbers of [`Self::text_key`] of `count` rows, of which each applies to some. Batches with one text share
    /// memory.
    pub fn keys_of_runs(
        &mut self,
        runs: impl Iterator<Item = (Option<Key>, usize)> + Clone,
        count: usize,
    ) -> NumberParts<Key> {
        if let Some((first, _)) = runs.clone().next()
            && runs.clone().all(|(key, _)| key == first)
        {
            return self.equal_keys(first, count);
        }
        NumberParts::of_runs(runs, count)
    }

    /// The same number of [`Self::text_key`] in `count` rows. Batches share memory.
    pub fn equal_keys(&mut self, key: Option<Key>, count: usize) -> NumberParts<Key> {
        let known = self.equal.take().filter(|(known, parts)| *known == key && parts.values.len() >= count);
        let known =
            known.unwrap_or_else(|| (key, NumberParts::of_runs(std::iter::once((key, count)), count)));
        self.equal.insert(known).1.first_rows(count)
    }
}

/// A column of numbers of texts.
///
/// # Errors
/// If a number has no text.
pub fn dictionary_array(keys: NumberParts<Key>, texts: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    let keys = Int32Array::new(keys.values, keys.valid);
    Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(keys, Arc::clone(texts))?))
}
