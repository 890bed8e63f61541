//! Arrays of the hot path.

use std::ops::{Deref, DerefMut, Index, IndexMut, Range};

/// A vector whose elements are fetched without a bounds check in release builds.
///
/// Every index into one comes from `Topology`, `Colliders` or a loop over its own length: made once, when a batch is
/// made, of a model whose own indices were all checked before (`Model::check_indices`), and never from outside. Debug
/// builds, which the tests and the fuzz target `batch_steps` are, check each access. The checks and the lengths kept for
/// them were a fifth of all instructions of a single environment's step.
#[derive(Debug, Clone)]
pub(crate) struct Array<T>(Vec<T>);

impl<T> From<Vec<T>> for Array<T> {
    fn from(values: Vec<T>) -> Self {
        Self(values)
    }
}

impl<T> Deref for Array<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T> DerefMut for Array<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.0
    }
}

impl<T> Index<usize> for Array<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, index: usize) -> &T {
        debug_assert!(index < self.0.len());
        unsafe { self.0.get_unchecked(index) }
    }
}

impl<T> IndexMut<usize> for Array<T> {
    #[inline(always)]
    fn index_mut(&mut self, index: usize) -> &mut T {
        debug_assert!(index < self.0.len());
        unsafe { self.0.get_unchecked_mut(index) }
    }
}

impl<T> Array<T> {
    /// The elements of `range`, with the same terms as an index.
    #[inline(always)]
    pub fn part_mut(&mut self, range: Range<usize>) -> &mut [T] {
        debug_assert!(range.start <= range.end && range.end <= self.0.len());
        unsafe { self.0.get_unchecked_mut(range) }
    }
}

impl<T> Array<T> {
    /// `N` elements from `start` on, of a length that the compiler knows.
    #[inline(always)]
    pub fn chunk<const N: usize>(&self, start: usize) -> &[T; N] {
        debug_assert!(start + N <= self.0.len());
        unsafe { &*self.0.as_ptr().add(start).cast() }
    }

    /// `N` elements from `start` on, mutable.
    #[inline(always)]
    pub fn chunk_mut<const N: usize>(&mut self, start: usize) -> &mut [T; N] {
        debug_assert!(start + N <= self.0.len());
        unsafe { &mut *self.0.as_mut_ptr().add(start).cast() }
    }
}

impl<'a, T> IntoIterator for &'a Array<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    #[inline(always)]
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Array<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;
    #[inline(always)]
    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}
