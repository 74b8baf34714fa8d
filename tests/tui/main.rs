//! Behaviour of the program as its user sees it.
