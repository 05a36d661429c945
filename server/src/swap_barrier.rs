//! swap_barrier
