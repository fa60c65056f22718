"""The archive of a plant: sealed runs as Parquet in a folder or an S3 bucket, found again, fetched and asked."""
