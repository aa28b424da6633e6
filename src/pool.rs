//! Arrays of which spans are given to characters and taken back.

use std::ops::{Deref, DerefMut, Range};

/// An array of spans that come and go: a new one takes the first gap that holds it, or goes behind the last. It never moves
/// another, so that what names a place in the array stays right.
#[derive(Debug, Clone, PartialEq)]
pub struct Pool<T> {
    items: Vec<T>,
    /// Gaps in rising order; none touches another, or the end.
    free: Vec<Range<usize>>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self::from(Vec::new())
    }
}

impl<T> From<Vec<T>> for Pool<T> {
    fn from(items: Vec<T>) -> Self {
        let free = Vec::new();
        Self { items, free }
    }
}

impl<T> Deref for Pool<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.items
    }
}

impl<T> DerefMut for Pool<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.items
    }
}

impl<T> Pool<T> {
    /// Where a span of `len` would go.
    pub fn place(&self, len: usize) -> usize {
        let gap = self.free.iter().find(|gap| gap.len() >= len);
        gap.map_or(self.items.len(), |gap| gap.start)
    }

    /// Puts items at [`Self::place`], and returns their span.
    pub fn insert(&mut self, items: Vec<T>) -> Range<usize> {
        let span = self.place(items.len())..self.place(items.len()) + items.len();
        match self.free.iter().position(|gap| gap.len() >= items.len()) {
            Some(gap) => {
                self.free[gap].start = span.end;
                self.free.retain(|gap| !gap.is_empty());
                for (place, item) in self.items[span.clone()].iter_mut().zip(items) {
                    *place = item;
                }
            }
            None => self.items.extend(items),
        }
        span
    }

    /// Takes a span back that [`Self::insert`] returned. What stands there stays until another takes its place.
    pub fn remove(&mut self, span: Range<usize>) {
        if span.is_empty() {
            return;
        }
        let at = self.free.partition_point(|gap| gap.start < span.start);
        self.free.insert(at, span);
        self.free.dedup_by(|gap, before| {
            let touch = before.end == gap.start;
            if touch {
                before.end = gap.end;
            }
            touch
        });
        if let Some(last) = self.free.pop_if(|gap| gap.end == self.items.len()) {
            self.items.truncate(last.start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_take_the_first_gap_and_give_it_back() {
        let mut pool = Pool::from(vec![0]);
        let [a, b, c] = [3, 2, 4].map(|n| pool.insert(vec![n; n]));
        assert_eq!((a.clone(), b.clone(), c.clone()), (1..4, 4..6, 6..10));
        pool.remove(a);
        assert_eq!(pool.place(3), 1);
        assert_eq!(pool.place(4), 10);
        assert_eq!(pool.insert(vec![7]), 1..2);
        assert_eq!(pool.insert(vec![8; 3]), 10..13);
        // Gaps beside each other are one.
        pool.remove(b);
        assert_eq!(pool.insert(vec![9; 4]), 2..6);
        assert_eq!(&pool[..], [0, 7, 9, 9, 9, 9, 4, 4, 4, 4, 8, 8, 8]);
        // The array ends behind its last span.
        pool.remove(c);
        assert_eq!(pool.len(), 13);
        pool.remove(10..13);
        assert_eq!(pool.len(), 6);
        assert_eq!(pool.insert(Vec::new()), 6..6);
        pool.remove(6..6);
        pool.remove(2..6);
        pool.remove(1..2);
        assert_eq!(&pool[..], [0]);
        assert_eq!(pool, Pool::from(vec![0]));
    }
}
