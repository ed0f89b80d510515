"""What has no name: where it enters, and its simplest course."""
