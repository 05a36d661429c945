//! vs
