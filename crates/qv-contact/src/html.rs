//! `contact.html`.
