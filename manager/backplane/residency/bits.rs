//! A set of small numbers.

/// See the module's head. Numbers are below the length that it was made with.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits {
    words: Vec<u64>,
    len: usize,
}

impl Bits {
    /// Empty, of numbers below `len`.
    pub(crate) fn new(len: usize) -> Self {
        Self { words: vec![0; len.div_ceil(64)], len }
    }

    /// How many numbers there could be.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    pub(crate) fn has(&self, k: u32) -> bool {
        self.words[k as usize / 64] >> (k % 64) & 1 == 1
    }

    pub(crate) fn set(&mut self, k: u32) {
        self.words[k as usize / 64] |= 1 << (k % 64);
    }

    pub(crate) fn clear(&mut self, k: u32) {
        self.words[k as usize / 64] &= !(1 << (k % 64));
    }

    /// Adds a number; whether it wasn't there.
    pub(crate) fn add(&mut self, k: u32) -> bool {
        let is_new = !self.has(k);
        self.set(k);
        is_new
    }

    /// Takes all out.
    pub(crate) fn empty(&mut self) {
        self.words.fill(0);
    }

    /// Leaves what is in both.
    pub(crate) fn and(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(own, other)| *own &= other);
    }

    /// The numbers, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.words.iter().enumerate().flat_map(|(at, word)| {
            let mut left = *word;
            std::iter::from_fn(move || {
                let k = (left != 0).then(|| at as u32 * 64 + left.trailing_zeros())?;
                left &= left - 1;
                Some(k)
            })
        })
    }
}
