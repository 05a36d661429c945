//! An array of which few cells are ever written: memory is taken for those, by the page.

/// Cells of a page.
const PAGE: usize = 64;
const NONE: u32 = u32::MAX;

/// Cells by number. Those that were never written are all the same.
#[derive(Clone, Debug, Default)]
pub(super) struct Sparse<T> {
    /// For each page where its cells begin, in pages, or [`NONE`].
    pages: Vec<u32>,
    cells: Vec<T>,
    unwritten: T,
}

impl<T: Copy> Sparse<T> {
    pub fn new(unwritten: T) -> Self {
        Self { pages: Vec::new(), cells: Vec::new(), unwritten }
    }

    /// Makes room for so many cells in all; what is there stays.
    pub fn grow(&mut self, count: usize) {
        self.pages.resize(count.div_ceil(PAGE).max(self.pages.len()), NONE);
    }

    /// A cell; what lies beyond the room was never written.
    #[inline]
    pub fn get(&self, at: usize) -> T {
        match self.pages.get(at / PAGE) {
            Some(page) if *page != NONE => self.cells[*page as usize * PAGE + at % PAGE],
            _ => self.unwritten,
        }
    }

    /// A cell to write, within the room.
    #[inline]
    pub fn get_mut(&mut self, at: usize) -> &mut T {
        let page = &mut self.pages[at / PAGE];
        if *page == NONE {
            *page = (self.cells.len() / PAGE) as u32;
            self.cells.resize(self.cells.len() + PAGE, self.unwritten);
        }
        &mut self.cells[*page as usize * PAGE + at % PAGE]
    }

    /// All cells of pages that were written.
    pub fn written(&mut self) -> impl Iterator<Item = &mut T> {
        self.cells.iter_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_not_written_is_all_the_same() {
        let mut sparse = Sparse::new(7u32);
        assert_eq!(sparse.get(3), 7);
        sparse.grow(1000);
        *sparse.get_mut(999) = 1;
        *sparse.get_mut(64) += 1;
        assert_eq!([0, 63, 64, 65, 998, 999, 5000].map(|at| sparse.get(at)), [7, 7, 8, 7, 7, 1, 7]);
        sparse.grow(10);
        assert_eq!((sparse.get(999), sparse.written().count()), (1, 128), "nothing is lost");
    }
}
