pub mod instant;
